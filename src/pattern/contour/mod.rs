//! Closed curves of straight lines, arcs of ellipses and cubics, as drawn, and regions within them.

mod area;
mod edge;
mod fill;
mod piece;

pub(super) use area::{area, area_within};
pub(super) use fill::cells as cells_of_polygons;
pub use fill::{Contours, FillRule};
pub use piece::{Arc, Contour, Piece};

pub(crate) type Point = [f64; 2];

/// How far outside of a border a point still counts as on it, relative to the coordinates: rounding must not make the
/// cells of a symmetric region asymmetric.
pub(super) const RESOLUTION: f64 = 1e-12;
