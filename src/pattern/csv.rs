//! Reads patterns from tables with a line for each row, as spreadsheets, MATLAB and `numpy.savetxt` write them.
//!
//! The first line is row y = 0, the lower edge of the membrane, since arrays are `[y][x]` with the origin at the lower
//! left and `numpy.savetxt` writes row 0 first.

use std::path::Path;

use super::file::{Cells, FilePatterns, PatternFileError};
use super::raster::{PatternForm, Raster};
use deaflow_base::Table;

/// Bytes allowed for each value with its separator, and for comments.
const MAX_BYTES: (u64, u64) = (64, 1 << 20);

fn allowed(path: &Path, form: PatternForm) -> String {
    let [columns, rows] = form.raster.sides();
    format!(
        "allowed: {rows} lines of {columns} values separated by commas, semicolons, tabs or blanks; the first line is \
         the lower edge; lines that begin with # or % are skipped{}",
        other_cells(path, form).unwrap_or_default()
    )
}

/// Tells how to simulate the cells of a file with another number of columns or rows; `None` if its lines differ in
/// length, or are not a possible number.
fn other_cells(path: &Path, form: PatternForm) -> Option<String> {
    let most = (Raster::MOST * Raster::MOST) as u64;
    let mut table = Table::open(path, MAX_BYTES.0 * most + MAX_BYTES.1).ok()?;
    let (mut columns, mut rows) = (0, 0);
    while let Some(row) = table.next_row().ok()? {
        columns = if rows == 0 { row.len() } else { columns };
        rows += 1;
        if row.len() != columns || row.empty(columns).is_some() {
            return None;
        }
    }
    let found = Raster::new(columns, rows).filter(|found| *found != form.raster && columns.min(rows) > 1)?;
    let cells = match columns == rows {
        true => format!("geometry.cells={columns}"),
        false => format!("geometry.cells=[{columns}, {rows}]"),
    };
    Some(format!(
        "; or simulate {found} cells: `--set {cells}` (of a pipeline `--set scene.{cells}`)"
    ))
}

/// Returns the numbers of columns and rows.
pub(super) fn sides(path: &Path) -> Result<[usize; 2], PatternFileError> {
    let most = (Raster::MOST * Raster::MOST) as u64;
    let mut table = Table::open(path, MAX_BYTES.0 * most + MAX_BYTES.1)?;
    let mut sides = [0; 2];
    while let Some(row) = table.next_row()? {
        sides = [if sides[1] == 0 { row.len() } else { sides[0] }, sides[1] + 1];
    }
    Ok(sides)
}

pub(super) fn read(path: &Path, form: PatternForm) -> Result<FilePatterns, PatternFileError> {
    let refusal = |what: String| PatternFileError::new(what).help(allowed(path, form));
    let [columns, rows] = form.raster.sides();
    let mut table = Table::open(path, MAX_BYTES.0 * form.raster.cells() as u64 + MAX_BYTES.1)?;
    let mut values = Vec::with_capacity(form.raster.cells());
    while let Some(row) = table.next_row()? {
        if let Some(at) = row.empty(columns) {
            return Err(refusal(row.error(format!("value {at} is empty")).to_string()));
        }
        if row.len() != columns {
            return Err(refusal(format!("line {} has {} values", row.line, row.len())));
        }
        for column in 0..columns {
            values.push(row.number(column)?);
        }
    }
    if values.len() != form.raster.cells() {
        let found = values.len() / columns;
        return Err(refusal(format!(
            "the file has {found} lines of values, expected {rows}"
        )));
    }
    let mut cells = Cells::new(form, 1);
    cells.add(&values)?;
    cells.finish()
}
