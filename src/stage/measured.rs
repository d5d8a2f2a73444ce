//! Measurements: what files of them have, and parameters of a scene that are fitted to them.

mod columns;
mod compare;
mod content;
pub mod curve;
mod described;
mod device;
mod dynamic;
mod field;
mod file;
mod free;
mod joint;
mod laws;
mod mesh;
mod motion;
mod orientation;
mod ranges;
mod set;
mod stored;
mod table;

pub use compare::{Agreement, Compared, Values, WithEffect, compare, compare_all, with_neglected_effects};
pub use content::{compared_files, compared_rows};
pub use described::{dimension_of, outlier, with_interval};
pub use device::{Device, viscous_law};
pub use dynamic::DynamicSet;
pub use file::{MeasuredFile, Measurement, path_of};
pub use free::{FreeKey, VOLTAGE_OFFSET};
pub use joint::{SceneFit, fit_scene, replaces_known_elastomer};
pub use laws::{LAWS, MOST_BRANCHES, SpecimenFit, law_named, name_of_law};
pub use mesh::MeshChoice;
pub use ranges::{Deviations, Range};
pub use set::{Data, MeasuredSet, read_sets};
pub use table::{MeasuredTable, Rows, SigmaSource, named_notes};

#[cfg(test)]
mod tests;
