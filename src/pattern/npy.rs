//! Reads patterns from a NumPy array.

use std::path::Path;

use super::file::{MOST_CELLS, PatternFileError, bytes, count, patterns};
use super::raster::{Pattern, PatternForm};
use deaflow_base::{NpyError, NpyHeader};

/// Bytes of the largest array with eight-byte elements, and of its header.
const MAX_BYTES: u64 = MOST_CELLS * 8 + (1 << 16);

/// Returns the numbers of columns and rows of an array with one pattern.
pub(super) fn sides(path: &Path) -> Result<[usize; 2], PatternFileError> {
    let bytes = bytes(path, MAX_BYTES)?;
    let header = NpyHeader::read(&mut &bytes[..]).map_err(refused)?;
    let side = |length: u64| usize::try_from(length).unwrap_or(usize::MAX);
    match header.shape[..] {
        [rows, columns] => Ok([side(columns), side(rows)]),
        _ => Err(
            PatternFileError::new(format!("the array has {} axes", header.shape.len()))
                .help("allowed: (rows, columns)"),
        ),
    }
}

pub(super) fn read(path: &Path, form: PatternForm) -> Result<Vec<Pattern>, PatternFileError> {
    let bytes = bytes(path, MAX_BYTES)?;
    let mut data = &bytes[..];
    let header = NpyHeader::read(&mut data).map_err(refused)?;
    let n = count(&header.shape, form)?;
    let (cells, columns, rows) = (form.raster.cells(), form.raster.columns(), form.raster.rows());
    let expected = n * cells * header.element.size();
    if data.len() != expected {
        return Err(PatternFileError::new(format!(
            "the header announces {expected} bytes of data, the file has {}",
            data.len()
        ))
        .help("the file is truncated or damaged; write it again"));
    }
    let stored = header.element.values(data);
    if !header.fortran {
        return patterns(&stored, form);
    }
    // In Fortran order the first index runs fastest: element (i, y, x) is at i + n·(y + rows·x).
    let at = |k: usize| k / cells + n * (k % cells / columns + rows * (k % columns));
    patterns(&(0..stored.len()).map(|k| stored[at(k)]).collect::<Vec<_>>(), form)
}

fn refused(error: NpyError) -> PatternFileError {
    let refusal = PatternFileError::new(error.to_string());
    match error.help() {
        Some(help) => refusal.help(help),
        None => refusal,
    }
}
