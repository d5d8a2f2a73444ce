//! A NumPy array of patterns.

use std::path::Path;

use super::raster::{Pattern, PatternForm};
use super::read::{MOST_CELLS, Refusal, bytes, count, patterns};
use deaflow_base::{NpyError, NpyHeader};

/// Eight-byte elements in the largest stack, and a header.
const MAX_BYTES: u64 = MOST_CELLS * 8 + (1 << 16);

/// Columns and rows of an array of one pattern.
pub(super) fn sides(path: &Path) -> Result<[usize; 2], Refusal> {
    let bytes = bytes(path, MAX_BYTES)?;
    let header = NpyHeader::read(&mut &bytes[..]).map_err(refused)?;
    let side = |length: u64| usize::try_from(length).unwrap_or(usize::MAX);
    match header.shape[..] {
        [rows, columns] => Ok([side(columns), side(rows)]),
        _ => Err(Refusal::new(format!("the array has {} axes", header.shape.len())).help("allowed: (rows, columns)")),
    }
}

pub(super) fn read(path: &Path, form: PatternForm) -> Result<Vec<Pattern>, Refusal> {
    let bytes = bytes(path, MAX_BYTES)?;
    let mut data = &bytes[..];
    let header = NpyHeader::read(&mut data).map_err(refused)?;
    let n = count(&header.shape, form)?;
    let (cells, columns, rows) = (form.raster.cells(), form.raster.columns(), form.raster.rows());
    let expected = n * cells * header.element.size();
    if data.len() != expected {
        return Err(Refusal::new(format!(
            "the header promises {expected} bytes of data, the file holds {}",
            data.len()
        ))
        .help("the file is cut off or damaged; write it again"));
    }
    let stored = header.element.values(data);
    if !header.fortran {
        return patterns(&stored, form);
    }
    // In Fortran order the first index runs fastest: element (i, y, x) stands at i + n·(y + rows·x).
    let at = |k: usize| k / cells + n * (k % cells / columns + rows * (k % columns));
    patterns(&(0..stored.len()).map(|k| stored[at(k)]).collect::<Vec<_>>(), form)
}

fn refused(error: NpyError) -> Refusal {
    let refusal = Refusal::new(error.to_string());
    match error.help() {
        Some(help) => refusal.help(help),
        None => refusal,
    }
}
