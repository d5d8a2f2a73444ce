//! Inner corners: the corners of the cells that are not on the edges of the raster. The edges do not move, so networks
//! predict displacements at inner corners only, 49 × 49 of the paper's membrane.

use deaflow_pattern::Raster;

/// Columns and rows of inner corners.
pub(crate) fn inner_sides(raster: Raster) -> [usize; 2] {
    raster.sides().map(|side| side - 1)
}

/// Number of inner corners.
pub(crate) fn inner_corners(raster: Raster) -> usize {
    inner_sides(raster).into_iter().product()
}
