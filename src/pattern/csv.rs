//! CSV files with a line for each row, as spreadsheets and `numpy.savetxt` write them.
//!
//! The first line is row y = 0, the lower edge of the membrane, since arrays are `[y][x]` with the origin at the lower
//! left and `numpy.savetxt` writes row 0 first.

use std::path::Path;

use super::file::{PatternFileError, bytes, patterns};
use super::raster::{Pattern, PatternForm, Raster};

/// Bytes allowed for each value with its separator, and for comments.
const MAX_BYTES: (u64, u64) = (64, 1 << 20);

fn allowed(form: PatternForm) -> String {
    let [columns, rows] = form.raster.sides();
    format!(
        "allowed: {rows} lines of {columns} values separated by commas, semicolons, tabs or single spaces; the first \
         line is the lower edge; lines that begin with # are skipped"
    )
}

/// Returns the separator of the first line of values: comma, semicolon or tab if the line has one, else the space that
/// `numpy.savetxt` writes.
fn separator(bytes: &[u8]) -> u8 {
    let first = bytes
        .split(|&b| b == b'\n')
        .find(|line| !line.starts_with(b"#"))
        .unwrap_or_default();
    [b',', b';', b'\t']
        .into_iter()
        .find(|s| first.contains(s))
        .unwrap_or(b' ')
}

/// Returns the numbers of columns and rows.
pub(super) fn sides(path: &Path) -> Result<[usize; 2], PatternFileError> {
    let most = (Raster::MOST * Raster::MOST) as u64;
    let bytes = bytes(path, MAX_BYTES.0 * most + MAX_BYTES.1)?;
    let mut sides = [0; 2];
    for record in reader(&bytes).byte_records() {
        let record = record.map_err(|e| PatternFileError::new(e.to_string()))?;
        sides = [if sides[1] == 0 { record.len() } else { sides[0] }, sides[1] + 1];
    }
    Ok(sides)
}

/// Returns a reader of the separated values, line by line.
fn reader(bytes: &[u8]) -> csv::Reader<&[u8]> {
    csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .delimiter(separator(bytes))
        .trim(csv::Trim::All)
        .from_reader(bytes)
}

pub(super) fn read(path: &Path, form: PatternForm) -> Result<Vec<Pattern>, PatternFileError> {
    let refusal = |what: String| PatternFileError::new(what).help(allowed(form));
    let bytes = bytes(path, MAX_BYTES.0 * form.raster.cells() as u64 + MAX_BYTES.1)?;
    let mut values = Vec::with_capacity(form.raster.cells());
    for record in reader(&bytes).records() {
        let record = record.map_err(|e| refusal(e.to_string()))?;
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != form.raster.columns() {
            return Err(refusal(format!("line {line} has {} values", record.len())));
        }
        for (column, text) in record.iter().enumerate() {
            let value = text.parse::<f64>().map_err(|_| {
                let text: String = text.chars().take(20).collect();
                PatternFileError::new(format!("line {line}, value {}: {text:?} is not a number", column + 1))
            })?;
            values.push(value);
        }
    }
    if values.len() != form.raster.cells() {
        return Err(refusal(format!(
            "the file has {} lines of values",
            values.len() / form.raster.columns()
        )));
    }
    patterns(&values, form)
}
