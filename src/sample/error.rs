//! Errors of families, and the number of cells at an area fraction.

use super::canvas::Canvas;

/// Invalid parameters of a family, or a sample that does not exist.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SampleError {
    /// An area fraction at which no cell or every cell would be active.
    #[error("the area fraction must leave at least one of {free} cells active and one bare, found {found}")]
    Area {
        /// The number of free cells.
        free: usize,
        /// The area fraction.
        found: f64,
    },
    /// A range of area fractions in the wrong order.
    #[error("the lower area fraction {low} is larger than the upper one {high}")]
    AreaRange {
        /// The lower end.
        low: f64,
        /// The upper end.
        high: f64,
    },
    /// More units than cells, or none.
    #[error("a large grid must have 1 to {most} units across the membrane, found {found}")]
    Units {
        /// The number of cells.
        most: usize,
        /// The number of units.
        found: usize,
    },
    /// An index beyond the last pattern.
    #[error("sample {index} does not exist: the family has {available} patterns")]
    Exhausted {
        /// The index.
        index: u64,
        /// The number of patterns.
        available: u64,
    },
}

/// Invalid parameters of a family in a stage.
#[derive(Debug)]
pub struct ParameterError {
    /// The key with the invalid value.
    pub key: &'static str,
    /// The reason.
    pub error: SampleError,
}

impl ParameterError {
    /// Creates errors for a key.
    pub fn of(key: &'static str) -> impl Fn(SampleError) -> Self {
        move |error| Self { key, error }
    }
}

/// Returns the number of active cells whose share of the free cells is nearest to `area`.
pub(super) fn cells_at(area: f64, canvas: &Canvas) -> Result<usize, SampleError> {
    let all = canvas.free_count();
    let cells = (area * all as f64).round();
    if (1.0..=(all - 1) as f64).contains(&cells) {
        Ok(cells as usize)
    } else {
        Err(SampleError::Area { free: all, found: area })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_are_rounded_to_the_nearest_cell() {
        assert_eq!(cells_at(0.5, &Canvas::PAPER), Ok(1250));
        assert_eq!(cells_at(0.05, &Canvas::PAPER), Ok(125));
        assert_eq!(cells_at(0.4999, &Canvas::PAPER), Ok(1250));
        for area in [0.0, 0.0001, 0.9999, 1.0, -0.5, f64::NAN, f64::INFINITY] {
            assert!(
                matches!(cells_at(area, &Canvas::PAPER), Err(SampleError::Area { .. })),
                "{area}"
            );
        }
    }
}
