//! Measurements: what files of them have, and parameters of a scene that are fitted to them.

mod columns;
mod compare;
pub mod curve;
mod device;
mod field;
mod file;
mod free;
mod joint;
mod orientation;

pub use compare::{Agreement, Compared, Quantities, Values, WithEffect, compare, compare_all, with_neglected_effects};
pub use device::{Device, viscous_law};
pub use file::{MeasuredFile, Measurement, path_of};
pub use free::{FreeKey, VOLTAGE_OFFSET};
pub use joint::{Data, MeasuredSet, SETTLED, SceneFit, fit_scene, read_sets, rounded};

#[cfg(test)]
mod tests;
