//! Finds the pattern that moves a point where it should go.
//!
//! Programs against [`crate::field::Predictor`] alone: whether a network, a linear response or the finite elements
//! stand behind it is not known here.

mod climb;
mod constraint;
mod evolve;
mod genome;
mod intuitive;
mod objective;
mod operators;

pub use climb::{Climb, Step, Terrain};
pub use constraint::{ConstraintError, Constraints, Limits, Region, Sides, Violations};
pub use evolve::{
    Admission, Evolution, EvolveError, EvolveOptions, GenerationReport, OptionsError, Setting, StateError, Stop, Watch,
    Winner, evolve, first_generation,
};
pub use genome::{Genome, UNITS};
pub use intuitive::Intuitive;
pub use objective::{AREA_PENALTY, Aim, Goal, GoalError, Measure, Motion};
