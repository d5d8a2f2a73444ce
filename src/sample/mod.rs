//! Draws electrode patterns: small grid, large grid, Bézier, area sweep.
//!
//! Sample i depends on the family, its parameters, the seed and i alone, so that more samples can be drawn later without
//! touching those that exist.

mod area_sweep;
mod bezier;
mod combination;
mod curve;
mod error;
mod family;
mod large_grid;
mod small_grid;

pub use area_sweep::AreaSweep;
pub use bezier::{Bezier, Ends};
pub use error::SampleError;
pub use family::Family;
pub use large_grid::LargeGrid;
pub use small_grid::SmallGrid;
