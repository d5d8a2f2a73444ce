//! Draws electrode patterns of several families, each in its own file; `family` holds the table of all.
//!
//! Sample i depends on the family, its parameters, the seed and i alone, so that more samples can be drawn later without
//! touching those that exist.

mod area_sweep;
mod areas;
mod bezier;
mod blobs;
mod checker;
mod combination;
mod curve;
mod curves;
mod error;
mod family;
mod large_grid;
mod membership;
mod small_grid;
mod stripes;

pub use area_sweep::AreaSweep;
pub use areas::{AreaFractions, Areas};
pub use bezier::{Bezier, Ends};
pub use blobs::Blobs;
pub use checker::Checker;
pub use curves::Curves;
pub use error::SampleError;
pub use family::{Entry, FAMILIES, Family, FamilyEntry, FamilyParameters, Group, MOST_SAMPLES, Refusal, read_family};
pub use large_grid::LargeGrid;
pub use membership::admits;
pub use small_grid::SmallGrid;
pub use stripes::Stripes;
