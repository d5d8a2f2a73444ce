//! Separated values, 50 lines of 50: the format that every spreadsheet and `numpy.savetxt` write.
//!
//! The first line is row y = 0, the lower edge of the membrane, since arrays are `[y][x]` with the origin at the lower
//! left and `numpy.savetxt` writes row 0 first.

use std::path::Path;

use super::raster::{CELLS, Pattern};
use super::read::{Refusal, bytes, patterns};

/// Generous for 2500 values with 25 digits each, and comments.
const MAX_BYTES: u64 = 1 << 20;

const FORM: &str = "allowed: 50 lines of 50 values separated by commas, semicolons, tabs or single spaces, the first line at the lower edge; lines that begin \
                    with # are skipped";

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

pub(super) fn read(path: &Path) -> Result<Vec<Pattern>, Refusal> {
    let bytes = bytes(path, MAX_BYTES)?;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .delimiter(separator(&bytes))
        .trim(csv::Trim::All)
        .from_reader(bytes.as_slice());
    let mut values = Vec::with_capacity(CELLS * CELLS);
    for record in reader.records() {
        let record = record.map_err(|e| Refusal::new(e.to_string()).help(FORM))?;
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != CELLS {
            return Err(Refusal::new(format!("line {line} has {} values", record.len())).help(FORM));
        }
        for (column, text) in record.iter().enumerate() {
            let value = text.parse::<f64>().map_err(|_| {
                let text: String = text.chars().take(20).collect();
                Refusal::new(format!("line {line}, value {}: {text:?} is not a number", column + 1))
            })?;
            values.push(value);
        }
    }
    if values.len() != CELLS * CELLS {
        return Err(Refusal::new(format!("{} lines of values", values.len() / CELLS)).help(FORM));
    }
    patterns(&values)
}
