//! Names, extents and number of rows of the two arrays that an imported file holds.

use super::error::ImportError;
use deaflow_pattern::Raster;

/// The largest number of rows in one file, and in all files of an import.
pub const MAX_ROWS: usize = 100_000;

/// Names of the arrays.
pub(super) const PATTERNS: &str = "patterns";
pub(super) const DISPLACEMENT: &str = "displacement";

/// Returns the extents of one row of `patterns`.
pub(super) fn pattern_extents(raster: Raster) -> [u64; 2] {
    let [columns, rows] = raster.sides().map(|side| side as u64);
    [rows, columns]
}

/// Returns the extents of one row of `displacement`.
pub(super) fn field_extents(raster: Raster) -> [u64; 3] {
    let [columns, rows] = raster.corner_sides().map(|side| side as u64);
    [rows, columns, 2]
}

/// Returns the number of rows of two arrays with these shapes.
pub(super) fn count_rows(patterns: &[u64], displacement: &[u64], raster: Raster) -> Result<usize, ImportError> {
    let rows = |name: &'static str, row: &[u64], shape: &[u64]| match shape.split_first() {
        Some((n, rest)) if rest == row => Ok(*n),
        _ => Err(ImportError::Shape {
            name,
            found: shape.to_vec(),
            expected: row.to_vec(),
        }),
    };
    let patterns = rows(PATTERNS, &pattern_extents(raster), patterns)?;
    let fields = rows(DISPLACEMENT, &field_extents(raster), displacement)?;
    match (patterns, fields) {
        (0, 0) => Err(ImportError::Empty),
        (patterns, fields) if patterns != fields => Err(ImportError::Lengths { patterns, fields }),
        (rows, _) if rows > MAX_ROWS as u64 => Err(ImportError::Rows(rows)),
        (rows, _) => Ok(rows as usize),
    }
}
