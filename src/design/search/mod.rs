//! The search of one target: by the genetic algorithm, whose designs may be refined along the gradient, or along the gradient
//! alone.

mod found;
mod genetic;
mod gradient;
mod probe;
mod refine;
mod shortage;

pub use found::{FoundDesign, Refinement, SearchResult};
pub use probe::{Candidate, Probe, References, cheapest_evaluator};

use super::constraint::Constraints;
use super::evolve::{EvolveError, Watch};
use super::intuitive::Intuitive;
use super::local_search::{SearchProblem, SearchStep, Unsuited};
use super::options::{Method, SearchOptions};
use super::target::Target;
use deaflow_base::Stopped;
use deaflow_field::{Differentiable, Feasibility, PredictError, StateFields};
use deaflow_pattern::{CELLS, Pattern};

/// One target, what its designs must keep to, and how they are searched.
pub struct Search<'a> {
    /// What is to be designed.
    pub target: &'a Target,
    /// What designs must keep to.
    pub constraints: &'a Constraints,
    /// How to search.
    pub options: &'a SearchOptions,
    /// Of each state of the device the group of electrodes that drives it.
    pub drivers: &'a [u8],
    /// Finite elements.
    pub elements: &'a dyn Elements,
    /// Follows the search.
    pub progress: &'a dyn Progress,
}

/// Finite elements, set up when a search first needs them: one without refinement and without margins never does.
pub trait Elements {
    /// What predicts fields, and how they change with the pattern.
    ///
    /// # Errors
    /// When the scene cannot be simulated.
    fn gradient(&self) -> Result<&dyn Differentiable<StateFields>, SearchError>;

    /// What [`Elements::gradient`] is called as an evaluator, on one line.
    fn settings(&self) -> String;

    /// What checks the margins that the constraints ask for, if they ask for any.
    ///
    /// # Errors
    /// When the scene cannot be simulated.
    fn feasibility(&self) -> Result<Option<&dyn Feasibility>, SearchError>;
}

/// Follows a search.
pub trait Progress: Watch {
    /// After each step along the gradient.
    fn step(&self, step: &SearchStep);

    /// After each local search.
    fn searched(&self);
}

/// What keeps an evaluator from being set up.
pub type Cause = Box<dyn std::error::Error + Send + Sync>;

/// What judges the patterns of the genetic algorithm.
pub enum Evaluators {
    /// This one.
    Named(Candidate),
    /// The cheapest of these that is accurate enough: from the cheapest to the most expensive, the last being the reference.
    Cheapest(Vec<Candidate>),
}

/// Why a search has no result.
#[derive(Debug, thiserror::Error)]
pub enum SearchError {
    /// The evaluator cannot be used.
    #[error("{{ {settings} }}: {why}")]
    Evaluator {
        /// Its settings.
        settings: String,
        /// What is wrong with it.
        why: Cause,
    },
    /// The finite elements cannot be set up.
    #[error(transparent)]
    Setup(Cause),
    /// It was asked to stop.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The genetic algorithm found nothing.
    #[error("`{target}`: {source}")]
    Evolve {
        /// The target.
        target: String,
        /// Why not.
        source: EvolveError,
    },
    /// A local search cannot start from the genetic algorithm's design.
    #[error("`{target}`: the design cannot be refined: it {why}")]
    Refine {
        /// The target.
        target: String,
        /// Why not.
        why: Unsuited,
    },
    /// A local search cannot start from anywhere.
    #[error("`{target}`: each of the {tried} patterns that were tried {why}")]
    NoStart {
        /// The target.
        target: String,
        /// How many were tried.
        tried: usize,
        /// Why the one failed that came nearest.
        why: Unsuited,
    },
    /// A field cannot be predicted.
    #[error(transparent)]
    Predict(#[from] PredictError),
}

impl SearchError {
    /// Whether nothing that was tried has a stable field.
    #[must_use]
    pub fn is_of_stability(&self) -> bool {
        match self {
            Self::Evolve { source, .. } => matches!(source, EvolveError::NoField),
            Self::Refine { why, .. } | Self::NoStart { why, .. } => *why == Unsuited::Field,
            Self::Evaluator { .. } | Self::Setup(_) | Self::Stopped(_) | Self::Predict(_) => false,
        }
    }
}

impl<'a> Search<'a> {
    /// Searches by the method that the options name; `evaluators` judge patterns of the genetic algorithm.
    ///
    /// # Errors
    /// When no evaluator can be used, or nothing that is tried has a field.
    pub fn run(&self, evaluators: impl FnOnce() -> Evaluators) -> Result<SearchResult, SearchError> {
        match self.options.method {
            Method::Ga => self.genetic(evaluators()),
            Method::Adjoint => self.along_gradient(),
        }
    }

    /// What checks the margins, where any are asked for.
    fn feasibility(&self) -> Result<Option<&'a dyn Feasibility>, SearchError> {
        match self.constraints.limits().has_margins() {
            true => self.elements.feasibility(),
            false => Ok(None),
        }
    }

    /// The problem of a local search for a design that differs from some others.
    fn problem(&self, others: &[Pattern]) -> Result<SearchProblem<'a>, SearchError> {
        let problem = self.problem_on(self.options.units)?;
        Ok(problem
            .with_feasibility(self.feasibility()?)
            .distant_from(others, self.options.distance.to_f64()))
    }

    /// The same without margins and other designs, on so many units along a side.
    fn problem_on(&self, units: usize) -> Result<SearchProblem<'a>, SearchError> {
        Ok(SearchProblem::new(
            self.elements.gradient()?,
            &self.target.goal,
            match units {
                CELLS => self.constraints.membrane().raster.sides(),
                units => [units; 2],
            },
            self.area_range(),
            self.constraints,
        ))
    }

    /// The area fractions that a design may have.
    fn area_range(&self) -> (f64, f64) {
        let tolerance = self.options.area_tolerance.to_f64();
        let around = |area: f64| (area - tolerance, area + tolerance);
        self.target.area.fraction().map_or((0.0, 1.0), around)
    }

    fn report_step(&self) -> impl Fn(&SearchStep) {
        |step: &SearchStep| self.progress.step(step)
    }

    fn intuitive(&self) -> Intuitive {
        let all = Intuitive::of(&self.target.goal, self.drivers);
        match self.constraints.room() {
            None => all,
            Some(room) => all.within(room),
        }
    }

    /// The intuitive design at the wanted area, or at its own where any will do.
    fn intuitive_start(&self) -> Pattern {
        let intuitive = self.intuitive();
        let area = self.target.area.fraction();
        area.map_or_else(|| intuitive.at_own_area(), |area| intuitive.at_area(area))
    }
}
