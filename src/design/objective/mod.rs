//! What a design is for: how it stands in a pipeline, and what it means for the displacement of a membrane.

mod field_file;
mod goal;
mod parameters;

pub(super) use goal::Placed;
pub use goal::{AREA_PENALTY, Aim, Goal, GoalError, Measure, Motion};
pub use parameters::Objective;
