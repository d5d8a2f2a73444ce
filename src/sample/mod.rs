//! Draws electrode patterns: small grid, large grid, Bézier, area sweep, stripes, blobs, curves.
//!
//! Sample i depends on the family, its parameters, the seed and i alone, so that more samples can be drawn later without
//! touching those that exist.

mod area_sweep;
mod areas;
mod bezier;
mod blobs;
mod combination;
mod curve;
mod curves;
mod error;
mod family;
mod large_grid;
mod small_grid;
mod stripes;

pub use area_sweep::AreaSweep;
pub use areas::Areas;
pub use bezier::{Bezier, Ends};
pub use blobs::Blobs;
pub use curves::Curves;
pub use error::SampleError;
pub use family::Family;
pub use large_grid::LargeGrid;
pub use small_grid::SmallGrid;
pub use stripes::Stripes;
