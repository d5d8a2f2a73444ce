//! Electrode patterns: which cells of the membrane carry an electrode, and the symmetries of the square on them.

mod raster;
mod symmetry;

pub use raster::{CELLS, Pattern, PatternError};
pub use symmetry::Symmetry;
