//! Selects the cheapest evaluator that is accurate enough, from predictions for some patterns of the search.
//!
//! Times are not reproducible, so none is measured here: candidates are ordered by their cost as measured by `deaflow
//! accuracy`. Errors are reproducible, and so is the selection.

use super::Cause;
use deaflow_field::{Evaluator, Field, InStates, PredictError, Predictor, StateFields};
use deaflow_pattern::Pattern;

/// Number of patterns of the first generation on which evaluators are compared.
pub(super) const PATTERNS: usize = 32;

/// An evaluator, or why it cannot be used.
pub struct Candidate {
    /// The settings on one line, as in an accuracy stage.
    pub settings: String,
    /// The evaluator in each state of the device, or the error.
    pub evaluator: Result<InStates<Box<dyn Evaluator>>, Cause>,
}

/// The errors of an evaluator relative to the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateAccuracy {
    /// The settings.
    pub settings: String,
    /// Root mean square error of a component in mm, over the patterns that have a field by both evaluators; 0 if there
    /// are none.
    pub rmse_mm: f64,
    /// The number of these patterns.
    pub known: u64,
    /// The number of patterns that have a field by only one of both evaluators.
    pub disagree: u64,
    /// The largest relative error of the displacement along the target directions, for patterns similar to designs; 0
    /// if there are none.
    pub design_error: f64,
}

/// Patterns similar to designs, with their displacements along the target directions.
pub struct DesignReferences<'a> {
    /// The patterns.
    pub patterns: &'a [Pattern],
    /// The displacements in mm by finite elements.
    pub values_mm: &'a [f64],
    /// The displacement of fields in mm.
    pub value_mm: &'a dyn Fn(&[Field]) -> f64,
}

/// The largest accepted relative error for patterns similar to designs.
const MAX_DESIGN_ERROR: f64 = 0.003;

impl CandidateAccuracy {
    fn is_sufficient(&self, accuracy_mm: f64) -> bool {
        self.known > 0 && self.disagree == 0 && self.rmse_mm <= accuracy_mm && self.design_error <= MAX_DESIGN_ERROR
    }
}

impl DesignReferences<'_> {
    /// The largest relative error of an evaluator; 1 if it has no field.
    fn error_of(&self, evaluator: &Candidate) -> Result<f64, PredictError> {
        let Ok(predictor) = &evaluator.evaluator else {
            return Ok(1.0);
        };
        let fields = predictor.predict_some(self.patterns)?;
        let error = |(fields, reference): (Option<StateFields>, &f64)| match fields {
            Some(fields) => ((self.value_mm)(&fields) - reference).abs() / reference.abs().max(SMALL_MM),
            None => 1.0,
        };
        Ok(fields.into_iter().zip(self.values_mm).map(error).fold(0.0, f64::max))
    }
}

/// Errors are relative to at least this displacement in mm.
const SMALL_MM: f64 = 0.05;

/// The first candidate that has an error of at most `accuracy_mm` on the patterns, agrees with the last one on which
/// of them have a field, and has a small error on patterns similar to designs; the last one if there is none. Also
/// returns the accuracy of each candidate.
///
/// # Errors
/// If an evaluator fails.
pub fn cheapest_evaluator(
    mut candidates: Vec<Candidate>,
    patterns: &[Pattern],
    designs: &DesignReferences<'_>,
    accuracy_mm: f64,
) -> Result<(Candidate, Vec<CandidateAccuracy>), PredictError> {
    let fields = |evaluator: &Candidate| match &evaluator.evaluator {
        Ok(predictor) => predictor.predict_some(patterns),
        Err(_) => Ok(vec![None; patterns.len()]),
    };
    let found: Vec<Vec<Option<StateFields>>> = candidates.iter().map(fields).collect::<Result<_, _>>()?;
    let reference = found.last().map_or(&[][..], Vec::as_slice);
    let pairs = candidates.iter().zip(&found);
    let accuracies = pairs.map(|(candidate, found)| {
        Ok(CandidateAccuracy {
            design_error: designs.error_of(candidate)?,
            ..compared(&candidate.settings, found, reference)
        })
    });
    let accuracies: Vec<CandidateAccuracy> = accuracies.collect::<Result<_, PredictError>>()?;
    let first = accuracies
        .iter()
        .position(|accuracy| accuracy.is_sufficient(accuracy_mm));
    let index = first.unwrap_or(candidates.len().saturating_sub(1));
    Ok((candidates.swap_remove(index), accuracies))
}

fn compared(settings: &str, found: &[Option<StateFields>], reference: &[Option<StateFields>]) -> CandidateAccuracy {
    let pairs = || found.iter().zip(reference);
    let both = || pairs().filter_map(|(found, reference)| Some((found.as_ref()?, reference.as_ref()?)));
    let of_states = both().flat_map(|(found, reference)| found.iter().zip(reference));
    let errors: Vec<f64> = of_states
        .map(|(found, reference)| found.rms_difference(reference))
        .collect();
    let squares = errors.iter().fold(0.0, |sum, error| sum + error * error);
    CandidateAccuracy {
        settings: settings.to_owned(),
        rmse_mm: (squares / errors.len().max(1) as f64).sqrt(),
        known: both().count() as u64,
        disagree: pairs().filter(|(a, b)| a.is_some() != b.is_some()).count() as u64,
        design_error: 0.0,
    }
}
