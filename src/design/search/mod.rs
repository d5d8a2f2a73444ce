//! The search for designs of one target: by the genetic algorithm with optional refinement, or by gradient search.

mod candidates;
mod finished;
mod found;
mod front;
mod genetic;
mod genetic_front;
mod gradient;
mod refine;
mod result;
mod shortage;

pub use candidates::{Candidate, CandidateAccuracy, DesignReferences, cheapest_evaluator};
pub use found::{FoundDesign, Refinement, SearchResult};
pub use front::{FoundFront, PointOutcome};

use super::constraint::Constraints;
use super::evolve::{EvolveError, Observer};
use super::intuitive::Intuitive;
use super::local_search::{SearchProblem, SearchStep, StartError};
use super::objective::Goal;
use super::options::{Method, SearchOptions};
use super::target::{Area, Target};
use deaflow_base::Stopped;
use deaflow_field::{Differentiable, Feasibility, PredictError, StateFields};
use deaflow_pattern::{CELLS, Pattern};

/// A search for designs of one target.
pub struct Search<'a> {
    /// The target.
    pub target: &'a Target,
    /// The constraints on designs.
    pub constraints: &'a Constraints,
    /// The search options.
    pub options: &'a SearchOptions,
    /// The electrode group that drives each state of the device.
    pub drivers: &'a [u8],
    /// The finite element models.
    pub elements: &'a dyn FiniteElements,
    /// Observes the search.
    pub progress: &'a dyn SearchProgress,
}

/// Finite element models, created on first use: a search without refinement and margins does not need them.
pub trait FiniteElements {
    /// The model that predicts fields and gradients.
    ///
    /// # Errors
    /// If the scene cannot be simulated.
    fn gradient(&self) -> Result<&dyn Differentiable<StateFields>, SearchError>;

    /// The settings of [`FiniteElements::gradient`] on one line.
    fn settings(&self) -> String;

    /// The check of the margins; `None` without margins.
    ///
    /// # Errors
    /// If the scene cannot be simulated.
    fn feasibility(&self) -> Result<Option<&dyn Feasibility>, SearchError>;
}

/// Observes a search.
pub trait SearchProgress: Observer {
    /// Called after each step of a local search.
    fn step(&self, step: &SearchStep);

    /// Called after each local search.
    fn searched(&self);

    /// Called first if the search is resumed from a checkpoint, with the number of finished local searches.
    fn searched_before(&self, _searches: usize) {}
}

/// The error of an evaluator that cannot be created.
pub type Cause = Box<dyn std::error::Error + Send + Sync>;

/// The evaluators for the genetic algorithm.
pub enum Evaluators {
    /// One evaluator.
    Named(Candidate),
    /// The cheapest of these that is accurate enough. They are ordered by cost, and the last one is the reference.
    Cheapest(Vec<Candidate>),
}

/// Errors of a search.
#[derive(Debug, thiserror::Error)]
pub enum SearchError {
    /// The evaluator cannot be used.
    #[error("{{ {settings} }}: {why}")]
    Evaluator {
        /// Its settings.
        settings: String,
        /// The error.
        why: Cause,
    },
    /// The finite elements cannot be set up.
    #[error(transparent)]
    Setup(Cause),
    /// The search was stopped.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The genetic algorithm found nothing.
    #[error("`{target}`: {source}")]
    Evolve {
        /// The target.
        target: String,
        /// The error.
        source: EvolveError,
    },
    /// A local search cannot start from the genetic algorithm's design.
    #[error("`{target}`: the design cannot be refined: it {why}")]
    Refine {
        /// The target.
        target: String,
        /// The error.
        why: StartError,
    },
    /// No local search can start.
    #[error("`{target}`: each of the {tried} start patterns {why}")]
    NoStart {
        /// The target.
        target: String,
        /// The number of start patterns.
        tried: usize,
        /// The error; [`StartError::NoField`] if any pattern had it.
        why: StartError,
    },
    /// A field cannot be predicted.
    #[error(transparent)]
    Predict(#[from] PredictError),
}

impl SearchError {
    /// Whether no pattern has a stable solution.
    #[must_use]
    pub fn is_instability(&self) -> bool {
        match self {
            Self::Evolve { source, .. } => matches!(source, EvolveError::NoField),
            Self::Refine { why, .. } | Self::NoStart { why, .. } => *why == StartError::NoField,
            Self::Evaluator { .. } | Self::Setup(_) | Self::Stopped(_) | Self::Predict(_) => false,
        }
    }
}

impl SearchError {
    /// Whether no pattern satisfies the target area and the constraints.
    #[must_use]
    pub fn is_contradiction(&self) -> bool {
        match self {
            Self::Refine { why, .. } | Self::NoStart { why, .. } => *why == StartError::NoPattern,
            _ => false,
        }
    }
}

impl<'a> Search<'a> {
    /// Searches by the method of the options; `evaluators` creates the evaluators for the genetic algorithm.
    ///
    /// # Errors
    /// If no evaluator can be used, or no pattern has a field.
    pub fn run(&self, evaluators: impl FnOnce() -> Evaluators) -> Result<SearchResult, SearchError> {
        match self.options.method {
            Method::Ga => self.genetic(evaluators()),
            Method::Adjoint => self.along_gradient(),
        }
    }

    /// The check of the margins; `None` without margins.
    fn feasibility(&self) -> Result<Option<&'a dyn Feasibility>, SearchError> {
        match self.constraints.limits().has_margins() {
            true => self.elements.feasibility(),
            false => Ok(None),
        }
    }

    /// The problem of a local search with a minimum distance from other designs.
    fn problem(&self, others: &[Pattern]) -> Result<SearchProblem<'a>, SearchError> {
        let problem = self.problem_on(self.options.units)?;
        Ok(problem
            .with_feasibility(self.feasibility()?)
            .distant_from(others, self.options.distance.to_f64()))
    }

    /// The problem without margins and other designs, on a number of units along a side.
    fn problem_on(&self, units: usize) -> Result<SearchProblem<'a>, SearchError> {
        Ok(self.problem_of((self.elements.gradient()?, &self.target.goal), units, self.area_range()))
    }

    /// The same for a model, a goal and a range of the area fraction.
    fn problem_of<'m>(
        &self,
        (model, goal): (&'m dyn Differentiable<StateFields>, &'m Goal),
        units: usize,
        area: (f64, f64),
    ) -> SearchProblem<'m>
    where
        'a: 'm,
    {
        let units = match units {
            CELLS => self.constraints.membrane().raster.sides(),
            units => [units; 2],
        };
        SearchProblem::new(model, goal, units, area, self.constraints)
    }

    /// The allowed range of the area fraction.
    fn area_range(&self) -> (f64, f64) {
        let tolerance = self.options.area_tolerance.to_f64();
        let around = |area: f64| (area - tolerance, area + tolerance);
        match self.target.area {
            Area::Free => (0.0, 1.0),
            Area::Near(area) => around(area.to_f64()),
            Area::AtMost(area) => (0.0, area.to_f64()),
        }
    }

    fn report_step(&self) -> impl Fn(&SearchStep) {
        |step: &SearchStep| self.progress.step(step)
    }

    /// The intuitive design, outside of regions that are kept out. It does not keep other constraints.
    fn intuitive(&self) -> Intuitive {
        let all = Intuitive::of(&self.target.goal, self.drivers);
        let available = match self.constraints.available() {
            None => all,
            Some(cells) => all.within(cells),
        };
        match self.constraints.keep_out() {
            true => available.only_on(self.constraints.allowed()),
            false => available,
        }
    }

    /// The intuitive design at the target area, or at its own area if the area is free or not smaller.
    fn intuitive_start(&self) -> Pattern {
        let intuitive = self.intuitive();
        match self.target.area {
            Area::Free => intuitive.at_own_area(),
            Area::Near(area) => intuitive.at_area(area.to_f64()),
            Area::AtMost(largest) => {
                let own = intuitive.at_own_area();
                match self.constraints.area_fraction(&own) <= largest.to_f64() {
                    true => own,
                    false => intuitive.at_area(largest.to_f64()),
                }
            }
        }
    }
}
