//! The interfaces between solvers or surrogates and the other crates: traits for simulation and prediction. The genetic
//! algorithm and the audit do not depend on the solver or network behind them.

use std::error::Error;
use std::fmt;

use super::displacement::Field;
use super::observation::Observation;
use super::outcome_kind::OutcomeKind;
use deaflow_pattern::Pattern;

/// The status in artifacts of a pattern without a field.
pub const NO_FIELD: &str = "no stable field";

/// How a simulation ended. Results without convergence have no field, never NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// A stable equilibrium was found.
    Converged,
    /// A field by a method that does not search for an equilibrium; its stability is unknown.
    Estimated,
    /// Such a method led to no state that a membrane can have: an element turns over, ellipticity is lost, or the
    /// forces are farther from balance than at rest. Nothing is known of stability.
    NoEstimate,
    /// The membrane snaps through: no stable equilibrium at the full voltage. The loss of stability lies between the
    /// two voltages, in V.
    PullIn {
        /// The highest voltage at which a stable equilibrium was found.
        last_stable: f64,
        /// The lowest voltage at which none was found.
        first_unstable: f64,
    },
    /// Rank-one convexity is lost somewhere: the equations have no meaningful solution. It is lost between two
    /// voltages, in V.
    NotElliptic {
        /// The highest voltage at which a stable equilibrium was found.
        last_stable: f64,
        /// The lowest voltage at which none was found.
        first_unstable: f64,
    },
    /// The membrane has lost all tension somewhere, so its displacement there is not determined. That happens between
    /// two voltages, in V.
    Slack {
        /// The highest voltage at which an equilibrium in tension was found.
        last_stable: f64,
        /// The lowest voltage at which none was found.
        first_unstable: f64,
    },
    /// The membrane snaps through while it creeps or its voltage rises: it has a stable state up to a time, and none a
    /// little later.
    DelayedPullIn {
        /// The last time in s at which a stable state was found.
        last_stable: f64,
        /// The first time in s at which none was found.
        first_unstable: f64,
    },
    /// The membrane loses all tension somewhere while it creeps or its voltage rises.
    DelayedSlack {
        /// The last time in s at which a state in tension was found.
        last_stable: f64,
        /// The first time in s at which none was found.
        first_unstable: f64,
    },
    /// The iteration did not end within its limits; nothing is known about stability.
    IterationLimit,
    /// The work that a pattern is allowed was done before it ended; nothing is known about stability.
    WorkLimit,
}

impl Outcome {
    /// Returns its kind.
    #[must_use]
    pub fn kind(&self) -> OutcomeKind {
        match self {
            Self::Converged => OutcomeKind::Converged,
            Self::Estimated => OutcomeKind::Estimated,
            Self::NoEstimate => OutcomeKind::NoEstimate,
            Self::PullIn { .. } => OutcomeKind::PullIn,
            Self::NotElliptic { .. } => OutcomeKind::NotElliptic,
            Self::Slack { .. } => OutcomeKind::Slack,
            Self::DelayedPullIn { .. } => OutcomeKind::DelayedPullIn,
            Self::DelayedSlack { .. } => OutcomeKind::DelayedSlack,
            Self::IterationLimit => OutcomeKind::IterationLimit,
            Self::WorkLimit => OutcomeKind::WorkLimit,
        }
    }

    /// Returns the word in files, as in [`OutcomeKind`].
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.kind().name()
    }

    /// The voltages between which the stable branch ends, in V; `None` where it does not, or is not known to.
    #[must_use]
    pub fn bracket(&self) -> Option<[f64; 2]> {
        match *self {
            Self::PullIn {
                last_stable,
                first_unstable,
            }
            | Self::NotElliptic {
                last_stable,
                first_unstable,
            }
            | Self::Slack {
                last_stable,
                first_unstable,
            } => Some([last_stable, first_unstable]),
            _ => None,
        }
    }

    /// The times between which the stable states end, in s; `None` where they do not.
    #[must_use]
    pub fn time_bracket(&self) -> Option<[f64; 2]> {
        match *self {
            Self::DelayedPullIn {
                last_stable,
                first_unstable,
            }
            | Self::DelayedSlack {
                last_stable,
                first_unstable,
            } => Some([last_stable, first_unstable]),
            _ => None,
        }
    }

    /// Whether a stable equilibrium was found.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        matches!(self, Self::Converged)
    }

    /// Whether there is a field, be it that of an equilibrium or an estimate.
    #[must_use]
    pub fn has_field(&self) -> bool {
        self.kind().has_field()
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some([stable, unstable]) = self.time_bracket() {
            return write!(f, "{} between {stable:.6} s and {unstable:.6} s", self.name());
        }
        match self.bracket() {
            Some([stable, unstable]) => write!(f, "{} between {stable:.1} V and {unstable:.1} V", self.name()),
            None if *self == Self::WorkLimit => {
                write!(f, "{}: raise the time limit", self.name())
            }
            None => f.write_str(self.name()),
        }
    }
}

/// The result of simulating one pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// How it ended.
    pub outcome: Outcome,
    /// The displacement; present exactly when [`Outcome::has_field`] says so.
    pub field: Option<Field>,
    /// Newton steps over all load steps, or steps of an estimate.
    pub newton_iterations: u32,
    /// Relative residual at the end: that of the non-linear equilibrium, for estimates too.
    pub residual: f64,
    /// What the effects of the scene say beside the displacement; empty where there is no field.
    pub observation: Observation,
}

/// Something that simulates patterns under a fixed scene and mesh.
pub trait Simulator: Sync {
    /// One result per pattern, in order. A result does not depend on the other patterns or on the number of threads.
    fn simulate(&self, patterns: &[Pattern]) -> Vec<Simulation>;
}

/// A prediction that could not be made.
#[derive(Debug, thiserror::Error)]
pub enum PredictError {
    /// A field was asked for where there is none.
    #[error("the prediction failed: pattern {at} has no field")]
    NoField {
        /// Position of the pattern among those that were asked for.
        at: usize,
    },
    /// The numerical library failed, or gave something else than was asked for.
    #[error("the prediction failed: {0}")]
    Failed(Box<dyn Error + Send + Sync>),
}

impl PredictError {
    /// From what the numerical library reported.
    pub fn failed(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Failed(cause.into())
    }
}

/// Something that predicts fields fast: one of each pattern, or one in each state of a device.
pub trait Predictor<F = Field>: Sync {
    /// The field of each pattern, in order; `None` where a pattern has none: an estimate may lead nowhere, and an
    /// equilibrium may not be stable. A result does not depend on the other patterns or on the number of threads.
    ///
    /// # Errors
    /// When the model cannot be evaluated.
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<F>>, PredictError>;

    /// The same where every pattern must have a field.
    ///
    /// # Errors
    /// When the model cannot be evaluated, or a pattern has no field.
    fn predict(&self, patterns: &[Pattern]) -> Result<Vec<F>, PredictError> {
        let fields = self.predict_some(patterns)?.into_iter().enumerate();
        fields
            .map(|(at, field)| field.ok_or(PredictError::NoField { at }))
            .collect()
    }
}

/// A predictor that says which one it is: a network, an estimate or Newton's method, ready for the patterns of one
/// scene. Searches, measurements of accuracy and evaluations choose among evaluators and know nothing else of them.
pub trait Evaluator: Predictor + Send {
    /// Its settings on one line, in at most 64 bytes: the keys of a solve stage without braces, or `network: NAME`.
    fn settings(&self) -> String;

    /// Whether its fields are equilibria that are known to be stable.
    fn finds_equilibria(&self) -> bool {
        false
    }

    /// The error in mm that it promises to stay below on every pattern, if it does.
    fn promised_error_mm(&self) -> Option<f64> {
        None
    }

    /// How many patterns it is given at once where it serves; `None` where that makes no difference to its time.
    fn batch(&self) -> Option<usize> {
        None
    }
}

/// A field, and how a functional of it changes with the activity of each cell, `[group][y][x]`: with an electrode of
/// that group in it.
pub type WithGradient<F = Field> = (F, Vec<f64>);

/// Something that knows how the fields it predicts change with the pattern.
pub trait Differentiable<F = Field>: Predictor<F> {
    /// The field of a pattern, and the derivative with respect to the activity of each cell, `[group][y][x]`, of the
    /// functional whose derivative with respect to the displacement of each corner, per mm, `slope` gives; `None` where
    /// the pattern has no field.
    ///
    /// # Errors
    /// When the model cannot be evaluated.
    fn gradient(&self, pattern: &Pattern, slope: &dyn Fn(&F) -> F) -> Result<Option<WithGradient<F>>, PredictError>;

    /// The fields of patterns that differ little from one that has a field, by less work where that can be, and good
    /// enough to say which of them is best. Whether they are stable is not asked.
    ///
    /// # Errors
    /// When the model cannot be evaluated.
    fn predict_near(&self, _base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<F>>, PredictError> {
        self.predict_some(patterns)
    }

    /// Functionals Σ weights · u over the cell corners in the linear response of the membrane, u in mm: what each is
    /// without electrodes, and its derivative with respect to the activity of each cell, `[group][y][x]`, which sum to
    /// a rough value for any pattern. `None` where there is no such response.
    ///
    /// # Errors
    /// When the model cannot be evaluated.
    fn at_rest(&self, _weights: &[F]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        Ok(None)
    }
}
