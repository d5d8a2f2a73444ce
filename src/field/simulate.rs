//! Traits for simulation and prediction. They separate the genetic algorithm and the audit from solvers and networks.

use std::error::Error;
use std::fmt;

use super::displacement::Field;
use super::observation::Observation;
use super::outcome_kind::OutcomeKind;
use deaflow_pattern::Pattern;

/// The status of a pattern without a field in artifacts.
pub const NO_FIELD: &str = "no stable field";

/// How a simulation ended. Results without convergence have no field, never NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// A stable equilibrium was found.
    Converged,
    /// A field by a method that does not search for an equilibrium; its stability is unknown.
    Estimated,
    /// Such a method found no physical state: an element is inverted, ellipticity is lost, or the residual is larger
    /// than that of the undeflected membrane. The stability is unknown.
    NoEstimate,
    /// There is no stable equilibrium under the full pressure, or at the full volume: stability is lost between two
    /// shares of this load.
    LimitPoint {
        /// The largest share at which a stable equilibrium was found.
        last_stable: f64,
        /// The smallest share at which none was found.
        first_unstable: f64,
    },
    /// Pull-in: there is no stable equilibrium at the full voltage. Stability is lost between the two voltages in V.
    PullIn {
        /// The highest voltage at which a stable equilibrium was found.
        last_stable: f64,
        /// The lowest voltage at which none was found.
        first_unstable: f64,
    },
    /// Rank-one convexity is lost somewhere, so that the equations have no meaningful solution, between two voltages in
    /// V.
    NotElliptic {
        /// The highest voltage at which a stable equilibrium was found.
        last_stable: f64,
        /// The lowest voltage at which none was found.
        first_unstable: f64,
    },
    /// The membrane loses all tension somewhere, so that its displacement is undetermined, between two voltages in V.
    Slack {
        /// The highest voltage at which an equilibrium in tension was found.
        last_stable: f64,
        /// The lowest voltage at which none was found.
        first_unstable: f64,
    },
    /// Pull-in during creep or a rising voltage, between two times.
    DelayedPullIn {
        /// The last time in s at which a stable state was found.
        last_stable: f64,
        /// The first time in s at which none was found.
        first_unstable: f64,
    },
    /// The membrane loses all tension somewhere during creep or a rising voltage, between two times.
    DelayedSlack {
        /// The last time in s at which a state in tension was found.
        last_stable: f64,
        /// The first time in s at which none was found.
        first_unstable: f64,
    },
    /// The iteration limit was reached; the stability is unknown.
    IterationLimit,
    /// The work limit of a pattern was reached; the stability is unknown.
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
            Self::LimitPoint { .. } => OutcomeKind::LimitPoint,
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
        if let Self::LimitPoint {
            last_stable,
            first_unstable,
        } = self
        {
            let name = self.name();
            return write!(f, "{name} between {last_stable:.4} and {first_unstable:.4} of the load");
        }
        match self.bracket() {
            Some([0.0, 0.0]) => write!(f, "{} at 0 V: no stable state under the loads alone", self.name()),
            Some([stable, unstable]) => write!(f, "{} between {stable:.1} V and {unstable:.1} V", self.name()),
            None if *self == Self::WorkLimit => {
                write!(f, "{}: raise the time limit", self.name())
            }
            None => f.write_str(self.name()),
        }
    }
}

/// The result of a simulation of one pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// The outcome.
    pub outcome: Outcome,
    /// The displacement, if [`Outcome::has_field`].
    pub field: Option<Field>,
    /// Newton steps over all load steps, or steps of an estimate.
    pub newton_iterations: u32,
    /// The final relative residual of the non-linear equilibrium, also for estimates.
    pub residual: f64,
    /// Results other than the displacement; empty without a field.
    pub observation: Observation,
}

impl Simulation {
    /// Returns the displacement from rest, if there is one: see [`Observation::displacement_from_rest`].
    #[must_use]
    pub fn stroke(&self) -> Option<Field> {
        self.field
            .as_ref()
            .map(|field| self.observation.displacement_from_rest(field))
    }
}

/// Simulates patterns with a fixed scene and mesh.
pub trait Simulator: Sync {
    /// Returns one result per pattern, in order. A result does not depend on the other patterns or on the number of
    /// threads.
    fn simulate(&self, patterns: &[Pattern]) -> Vec<Simulation>;
}

/// Why a prediction failed.
#[derive(Debug, thiserror::Error)]
pub enum PredictError {
    /// A pattern has no field, but one was required.
    #[error("the prediction failed: pattern {at} has no field")]
    NoField {
        /// The position of the pattern in the request.
        at: usize,
    },
    /// The numerical library failed, or returned an unexpected result.
    #[error("the prediction failed: {0}")]
    Failed(Box<dyn Error + Send + Sync>),
}

impl PredictError {
    /// Creates an error from that of the numerical library.
    pub fn failed(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Failed(cause.into())
    }
}

/// Predicts a field `F` for each pattern: a displacement field, or one for each state of a device.
pub trait Predictor<F = Field>: Sync {
    /// Returns the field of each pattern, in order; `None` if an estimate fails or there is no stable equilibrium. A
    /// result does not depend on the other patterns or on the number of threads.
    ///
    /// # Errors
    /// When the model cannot be evaluated.
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<F>>, PredictError>;

    /// Does the same if every pattern must have a field.
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

/// A predictor with a description: a network, an estimate or Newton's method, set up for one scene. Searches, accuracy
/// measurements and evaluations only use this interface.
pub trait Evaluator: Predictor + Send {
    /// Returns the settings on one line, in at most 64 bytes: the keys of a solve stage without braces, or `network:
    /// NAME`.
    fn settings(&self) -> String;

    /// Returns whether the fields are stable equilibria.
    fn finds_equilibria(&self) -> bool {
        false
    }

    /// Returns the error bound in mm that holds for every pattern, if there is one.
    fn promised_error_mm(&self) -> Option<f64> {
        None
    }

    /// Returns the usual number of patterns in one call; `None` if it does not affect the time per pattern.
    fn batch(&self) -> Option<usize> {
        None
    }
}

/// A field, and the derivative of a functional of it with respect to the activity of each cell, `[group][y][x]`.
pub type WithGradient<F = Field> = (F, Vec<f64>);

/// A predictor with derivatives with respect to the pattern.
pub trait Differentiable<F = Field>: Predictor<F> {
    /// Returns the field of a pattern, and the derivative of a functional with respect to the activity of each cell,
    /// `[group][y][x]`; `None` if the pattern has no field. `slope` returns the derivative of the functional with
    /// respect to the displacement of each corner, per mm.
    ///
    /// # Errors
    /// When the model cannot be evaluated.
    fn gradient(&self, pattern: &Pattern, slope: &dyn Fn(&F) -> F) -> Result<Option<WithGradient<F>>, PredictError>;

    /// Returns the fields of patterns that differ little from one with a field, with less work if possible, and
    /// accurate enough to find the best of them. Their stability is not checked.
    ///
    /// # Errors
    /// When the model cannot be evaluated.
    fn predict_near(&self, _base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<F>>, PredictError> {
        self.predict_some(patterns)
    }

    /// Returns functionals Σ weights · u over the cell corners in the linear response of the membrane, u in mm: the
    /// value without electrodes and the derivative with respect to the activity of each cell, `[group][y][x]`, whose
    /// sum is a rough value for any pattern. `None` if there is no such response.
    ///
    /// # Errors
    /// When the model cannot be evaluated.
    fn linear_response(&self, _weights: &[F]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        Ok(None)
    }
}
