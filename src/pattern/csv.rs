//! Separated values, a line for each row: the format that every spreadsheet and `numpy.savetxt` write.
//!
//! The first line is row y = 0, the lower edge of the membrane, since arrays are `[y][x]` with the origin at the lower
//! left and `numpy.savetxt` writes row 0 first.

use std::path::Path;

use super::raster::{Pattern, Raster};
use super::read::{Refusal, bytes, patterns};

/// What a value may take with its separator, and comments: generous.
const MAX_BYTES: (u64, u64) = (64, 1 << 20);

fn form(raster: Raster) -> String {
    let [columns, rows] = raster.sides();
    format!(
        "allowed: {rows} lines of {columns} values separated by commas, semicolons, tabs or single spaces, the first line at the lower edge; lines that \
         begin with # are skipped"
    )
}

/// The separator of the first line of values: comma, semicolon or tab where it has one, else the space that
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

pub(super) fn read(path: &Path, raster: Raster) -> Result<Vec<Pattern>, Refusal> {
    let refusal = |what: String| Refusal::new(what).help(form(raster));
    let bytes = bytes(path, MAX_BYTES.0 * raster.cells() as u64 + MAX_BYTES.1)?;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .delimiter(separator(&bytes))
        .trim(csv::Trim::All)
        .from_reader(bytes.as_slice());
    let mut values = Vec::with_capacity(raster.cells());
    for record in reader.records() {
        let record = record.map_err(|e| refusal(e.to_string()))?;
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != raster.columns() {
            return Err(refusal(format!("line {line} has {} values", record.len())));
        }
        for (column, text) in record.iter().enumerate() {
            let value = text.parse::<f64>().map_err(|_| {
                let text: String = text.chars().take(20).collect();
                Refusal::new(format!("line {line}, value {}: {text:?} is not a number", column + 1))
            })?;
            values.push(value);
        }
    }
    if values.len() != raster.cells() {
        return Err(refusal(format!("{} lines of values", values.len() / raster.columns())));
    }
    patterns(&values, raster)
}
