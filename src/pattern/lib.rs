//! Electrode patterns: which cells of the membrane carry an electrode, the symmetries of the square on them, and the files
//! that they are read from.

mod bits;
mod csv;
mod h5;
mod layers;
mod membrane;
mod npy;
mod outline;
mod parts;
mod png;
mod raster;
mod read;
mod region;
mod role;
mod symmetry;

pub use bits::{Bits, distance};
pub use h5::split as split_h5;
pub use layers::{Layers, Likeness};
pub use membrane::Membrane;
pub use outline::{Corners, Island, Point, area as ring_area, outlines, total_area};
pub use parts::{Part, Parts, PartsError};
pub use raster::{CELLS, Pattern, PatternError, PatternForm, Raster, allowed_cells};
pub use read::{Refusal, read_mask, read_patterns, read_patterns_of};
pub use region::Region;
pub use role::Role;
pub use symmetry::{Symmetries, Symmetry};
