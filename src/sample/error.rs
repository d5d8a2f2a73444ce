//! What a family of patterns refuses, and the exact number of cells behind an area fraction.

use deaflow_pattern::Raster;

/// A family that cannot be drawn from, or a sample that it does not have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SampleError {
    /// An area fraction that leaves nothing to draw.
    #[error(
        "an area fraction lies above 0 and below 1, with at least one of {} cells active and one bare; found {found}",
        raster.cells()
    )]
    Area {
        /// The cells.
        raster: Raster,
        /// The fraction as given.
        found: f64,
    },
    /// Area fractions that are not in order.
    #[error("a range of area fractions goes from the smaller to the larger, found {low} to {high}")]
    AreaRange {
        /// The lower end as given.
        low: f64,
        /// The upper end as given.
        high: f64,
    },
    /// More units than cells, or none.
    #[error("a large grid has 1 to {most} units across the membrane, found {found}")]
    Units {
        /// Cells there.
        most: usize,
        /// The number as given.
        found: usize,
    },
    /// An index beyond the last pattern.
    #[error("there is no sample {index}: the family has {available} patterns")]
    Exhausted {
        /// The index as given.
        index: u64,
        /// How many patterns there are.
        available: u64,
    },
}

/// The number of active cells at an area fraction: the nearest to that share of all.
pub(super) fn cells_at(area: f64, raster: Raster) -> Result<usize, SampleError> {
    let all = raster.cells();
    let cells = (area * all as f64).round();
    if (1.0..=(all - 1) as f64).contains(&cells) {
        Ok(cells as usize)
    } else {
        Err(SampleError::Area { raster, found: area })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_are_rounded_to_the_nearest_cell() {
        assert_eq!(cells_at(0.5, Raster::PAPER), Ok(1250));
        assert_eq!(cells_at(0.05, Raster::PAPER), Ok(125));
        assert_eq!(cells_at(0.4999, Raster::PAPER), Ok(1250));
        for area in [0.0, 0.0001, 0.9999, 1.0, -0.5, f64::NAN, f64::INFINITY] {
            assert!(
                matches!(cells_at(area, Raster::PAPER), Err(SampleError::Area { .. })),
                "{area}"
            );
        }
    }
}
