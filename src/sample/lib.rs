//! Draws electrode patterns of several families, each in its own file.
//!
//! Sample i depends on the family, its parameters, the seed and i only, so that more samples can be drawn later without
//! changing the existing ones.

mod area_sweep;
mod areas;
mod bezier;
mod blobs;
mod canvas;
mod checker;
mod combination;
mod curve;
mod curves;
mod diagonals;
mod dithers;
mod error;
mod families;
mod family;
mod glyphs;
mod large_grid;
mod mazes;
mod membership;
mod small_grid;
mod spirals;
mod stripes;

pub use area_sweep::AreaSweep;
pub use areas::{AreaFractions, Areas};
pub use bezier::{Bezier, Ends};
pub use blobs::Blobs;
pub use canvas::Canvas;
pub use checker::Checker;
pub use curves::Curves;
pub use diagonals::Diagonals;
pub use dithers::Dithers;
pub use error::{ParameterError, SampleError};
pub use families::{FAMILIES, admits, read_family};
pub use family::{Family, FamilyEntry, FamilyOf, FamilyParameters, MOST_SAMPLES, SampleGroup};
pub use glyphs::Glyphs;
pub use large_grid::LargeGrid;
pub use mazes::Mazes;
pub use small_grid::SmallGrid;
pub use spirals::Spirals;
pub use stripes::Stripes;
