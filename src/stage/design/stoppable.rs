//! A model that fails once the run is stopped, so that a search along the gradient ends between two evaluations.

use deaflow_base::Stopped;
use deaflow_field::{Differentiable, PredictError, Predictor, StateFields, WithGradient};
use deaflow_orchestrator::Scratch;
use deaflow_pattern::Pattern;

/// The most similar patterns that are evaluated between two checks: some seconds at most.
const PIECE: usize = 64;

/// The model of a search.
pub struct Stoppable<'a> {
    model: &'a dyn Differentiable<StateFields>,
    scratch: &'a Scratch<'a>,
}

impl<'a> Stoppable<'a> {
    /// Wraps a model.
    pub fn new(model: &'a dyn Differentiable<StateFields>, scratch: &'a Scratch<'a>) -> Self {
        Self { model, scratch }
    }

    fn check(&self) -> Result<(), PredictError> {
        self.scratch.check_stopped().map_err(PredictError::failed)
    }
}

/// Whether an error is that of a stopped run.
pub fn is_stop(error: &PredictError) -> bool {
    matches!(error, PredictError::Failed(cause) if cause.is::<Stopped>())
}

impl Predictor<StateFields> for Stoppable<'_> {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.check()?;
        self.model.predict_some(patterns)
    }
}

impl Differentiable<StateFields> for Stoppable<'_> {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
    ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
        self.check()?;
        self.model.gradient(pattern, slope)
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        let mut all = Vec::with_capacity(patterns.len());
        for piece in patterns.chunks(PIECE) {
            self.check()?;
            all.extend(self.model.predict_near(base, piece)?);
        }
        Ok(all)
    }

    fn linear_response(&self, weights: &[StateFields]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        self.check()?;
        self.model.linear_response(weights)
    }
}
