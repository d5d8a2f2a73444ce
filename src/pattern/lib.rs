//! Electrode patterns: the cells of the membrane with an electrode, the symmetries of the square, and the readers of
//! pattern files.

mod array;
mod bits;
mod contour;
mod coverage;
mod csv;
mod drawing;
mod drawn;
mod electrodes;
mod fabricated;
mod file;
mod largest_area;
mod layers;
mod membrane;
mod outline;
mod parts;
mod picture;
mod polygons;
mod raster;
mod read;
mod region;
mod role;
mod shortage;
mod symmetry;

pub use bits::{Bits, distance};
pub use contour::{Arc, Contour, Contours, FillRule, Piece};
pub use coverage::{Coverage, CoverageError};
pub use deaflow_array::split as split_array;
pub use drawing::{Drawing, DrawingFormat, DrawingOptions, DrawingUnit, read_drawing, read_shape};
pub use drawn::{Edges, GroupRegion, pattern_of};
pub use electrodes::Electrodes;
pub use fabricated::{Fabricated, MaskOffsets, fabricated};
pub use file::{FilePatterns, PatternFileError, is_of_mask};
pub use largest_area::{AT_MOST, largest_area};
pub use layers::{Layers, PatternEquivalence};
pub use membrane::Membrane;
pub use outline::{Corners, Island, Point, area as ring_area, outlines, total_area};
pub use parts::{Part, Parts, PartsError};
pub use picture::PictureFormat;
pub use polygons::{Borders, Polygons};
pub use raster::{CELLS, Pattern, PatternError, PatternForm, Raster, allowed_cells};
pub use read::{form_of, has_patterns, read_mask, read_patterns, read_patterns_of};
pub use region::Region;
pub use role::Role;
pub use shortage::Shortage;
pub use symmetry::{Symmetries, Symmetry};
