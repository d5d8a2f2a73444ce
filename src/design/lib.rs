//! Design of electrode patterns that move points and bodies to targets.
//!
//! The crate uses the traits of [`deaflow_field`] only: fields may be predicted by a network, a linear response or
//! finite elements.

mod constraint;
mod evolve;
mod front;
mod genome;
mod intuitive;
mod local_search;
mod masks;
mod objective;
mod operators;
mod options;
mod planned;
mod search;
mod selection;
mod status;
mod target;
mod task;
mod text;

pub use constraint::{
    ConstraintError, ConstraintParameters, Constraints, DesignDomain, Limits, Pad, Sides, Violations,
};
pub use evolve::{
    CheckpointError, Evolution, EvolveError, EvolveOptions, EvolveProblem, FrontEvolution, FrontGeneration,
    FrontMember, FrontProblem, FrontReport, GenerationReport, Observer, OptionsError, Stop, Winner, evolve,
    evolve_front, first_generation,
};
pub use front::{
    Cost, Front, FrontMethod, FrontObjective, FrontPoint, LeastArea, LeastCharge, OtherObjective, Pareto, hypervolume,
    hypervolume_of,
};
pub use genome::{Genome, UNITS};
pub use intuitive::Intuitive;
pub use local_search::{LocalOptimum, SearchProblem, SearchStep, StartError};
pub use masks::Masked;
pub use objective::{
    AREA_PENALTY, Aim, BodyMarkers, Criterion, Displacement, Distance, Goal, GoalError, MEASURES, Masks, Measure,
    Motion, Objective, PlacedAim, Qin2024, RegionCells, ResponseKind, RoughScore, Subject, value_unit,
};
pub use options::{Method, SearchOptions};
pub use planned::PlannedDesign;
pub use search::{
    Candidate, CandidateAccuracy, Cause, DesignReferences, Evaluators, FiniteElements, FoundDesign, FoundFront,
    PointOutcome, Refinement, Search, SearchError, SearchProgress, SearchResult, cheapest_evaluator,
};
pub use selection::{DesignFilter, DesignLabel, SimulatedScore};
pub use status::own_pattern_status;
pub use target::{Area, CaseLabel, SINGLE_NAME, Target, Targets};
pub use task::DesignTask;

#[cfg(test)]
mod tests;
