//! Finds the pattern that moves points and bodies where they should go.
//!
//! Programs against the traits of [`deaflow_field`] alone: whether a network, a linear response or the finite elements predict
//! a field is not known here.

mod constraint;
mod evolve;
mod genome;
mod intuitive;
mod local_search;
mod objective;
mod operators;
mod options;
mod search;
mod selection;
mod target;
mod text;

pub use constraint::{ConstraintError, ConstraintParameters, Constraints, Ground, Limits, Sides, Violations};
pub use evolve::{
    Evolution, EvolveError, EvolveOptions, GenerationReport, OptionsError, Setting, StateError, Stop, Watch, Winner,
    evolve, first_generation,
};
pub use genome::{Genome, UNITS};
pub use intuitive::Intuitive;
pub use local_search::{LocalOptimum, SearchProblem, SearchStep};
pub use objective::{
    AREA_PENALTY, Aim, Displacement, Distance, Goal, GoalError, Lever, MEASURES, Measure, Moment, Motion, Objective,
    PlacedAim, Qin2024, RoughScore, Subject,
};
pub use options::{Method, SearchOptions};
pub use search::{
    Candidate, Cause, Elements, Evaluators, FoundDesign, Probe, Progress, References, Refinement, Search, SearchError,
    SearchResult, cheapest_evaluator,
};
pub use selection::{DesignFilter, DesignLabel, Merit};
pub use target::{Area, Target, Targets};
