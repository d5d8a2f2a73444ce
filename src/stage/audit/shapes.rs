//! Checks of the shapes of the arrays of a dataset, before they are read.

use std::path::Path;

use deaflow_dataset::audit::{Finding, Severity};
use deaflow_dataset::is_overlong;
use deaflow_pattern::Raster;
use deaflow_store::{RowFile, StoreError};

/// The arrays with one value per pattern.
const COLUMNS: [&str; 11] = [
    "split",
    "family",
    "outcome",
    "max_displacement",
    "orbit",
    "elements_per_cell",
    "order",
    "discretisation_error",
    "source",
    "symmetry",
    "bin",
];

/// Returns a finding if arrays of a file have the wrong shape; no row can be read then.
fn wrong_array_shapes(file: &RowFile, raster: Raster) -> Result<Option<Finding>, StoreError> {
    let ([columns, rows], [across, up]) = (raster.sides(), raster.corner_sides());
    let expected = [("patterns", vec![rows, columns]), ("displacement", vec![up, across, 2])];
    let mut lengths = Vec::new();
    let mut wrong = Vec::new();
    for (name, row) in expected {
        match file.shape(name)? {
            Some(shape) if shape.get(1..) == Some(&row) => lengths.push(shape[0]),
            Some(shape) => wrong.push(format!("`{name}` has the shape {shape:?}, not (n, {row:?})")),
            None => wrong.push(format!("there is no `{name}`")),
        }
    }
    if let [patterns, fields] = lengths[..]
        && patterns != fields
    {
        wrong.push(format!("there are {patterns} patterns and {fields} fields"));
    }
    Ok((!wrong.is_empty()).then(|| Finding::whole("shape", Severity::Error, wrong.join("; "))))
}

/// Returns the first problem with the shapes of a file.
///
/// # Errors
/// If the file cannot be read.
pub fn wrong_shapes(file: &RowFile, raster: Raster, path: &Path) -> Result<Option<Finding>, StoreError> {
    if let Some(finding) = wrong_array_shapes(file, raster)? {
        return Ok(Some(finding));
    }
    let Some(rows) = file.shape("patterns")?.and_then(|shape| shape.first().copied()) else {
        return Ok(None);
    };
    match too_many_rows(rows as u64, raster, path) {
        Some(finding) => Ok(Some(finding)),
        None => wrong_column_lengths(file, rows),
    }
}

/// Returns a finding if a file declares more rows than its bytes can hold: reading it would take for ever or exceed the
/// memory.
fn too_many_rows(rows: u64, raster: Raster, path: &Path) -> Option<Finding> {
    let bytes = std::fs::metadata(path).map_or(0, |found| found.len());
    let message = format!("`patterns` is said to have {rows} rows, more than a file of {bytes} bytes holds");
    is_overlong(rows, raster, bytes).then(|| Finding::whole("shape", Severity::Error, message))
}

/// Returns a finding if columns do not have one value per pattern. It is checked before reading, because a few bytes
/// can declare terabytes.
fn wrong_column_lengths(file: &RowFile, rows: usize) -> Result<Option<Finding>, StoreError> {
    let mut wrong = Vec::new();
    for name in COLUMNS {
        match file.shape(name)?.as_deref() {
            None => {}
            Some([length]) if *length == rows => {}
            Some([length]) => wrong.push(format!("`{name}` has {length}")),
            Some(shape) => wrong.push(format!("`{name}` has the shape {shape:?}")),
        }
    }
    let message = || format!("there are {rows} patterns, and {}", wrong.join(", "));
    Ok((!wrong.is_empty()).then(|| Finding::whole("shape", Severity::Error, message())))
}
