//! What a design is for: how it stands in a pipeline, and what it means for the displacement of a membrane.

mod aim;
mod field_file;
mod goal;
mod measure;
mod parameters;
mod rough;

pub use aim::{Aim, Lever, Motion, PlacedAim, Subject};
pub use goal::{AREA_PENALTY, Goal, GoalError};
pub use measure::{Displacement, Distance, MEASURES, Measure, Qin2024};
pub use parameters::{Moment, Objective};
pub use rough::RoughScore;
