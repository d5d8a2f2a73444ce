//! Objectives of designs: their declaration in YAML, and their evaluation on displacement fields.

mod aim;
mod definition;
mod error;
mod field_file;
mod goal;
mod measure;
mod points;
mod region;
mod robust;
mod rough;

pub use aim::{Aim, BodyMarkers, Motion, PlacedAim, Subject};
pub use definition::{Objective, ResponseKind};
pub use error::GoalError;
pub use goal::{AREA_PENALTY, Goal, value_unit};
pub use measure::{Displacement, Distance, MEASURES, Measure, Qin2024};
pub use region::RegionCells;
pub use robust::{Criterion, Masks};
pub(crate) use robust::{DRAWN, reach};
pub use rough::RoughScore;
