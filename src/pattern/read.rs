//! Reads the patterns that a person names on the command line, whatever program wrote them.
//!
//! A file that is not exactly zeros and ones on the cells of the membrane is refused with what was found and where: a solver fed a
//! resampled, clipped or transposed pattern would answer a question that nobody asked. Files are not trusted: sizes are
//! checked against what the file really holds before anything is allocated.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use super::raster::{Pattern, Raster};
use super::{csv, h5, npy, png};
use crate::base::InputError;

/// The most patterns that one argument may hold; on 50 × 50 cells their fields alone would be 830 MB.
const MOST: u64 = 20_000;

/// The most cells that one argument may hold.
pub(super) const MOST_CELLS: u64 = MOST * 2500;

const FORMS: &str = "a pattern is one of FILE.npy, FILE.csv, FILE.png, FILE.h5:/dataset";

/// Reads the patterns of one `PATTERN` argument.
///
/// - `FILE.npy`: (rows, columns) or (n, rows, columns), booleans, integers or floats, C or Fortran order.
/// - `FILE.csv`: a line for each row; the first line is row y = 0, the lower edge, as `numpy.savetxt(…, delimiter=",")`
///   writes the array.
/// - `FILE.png`: a pixel for each cell or a whole multiple, dark = electrode; the top of the image is the upper edge (largest y).
/// - `FILE.h5:/dataset` (or `.hdf5`): as `.npy`. Another process reads the file.
///
/// # Errors
/// When the file cannot be read, has another shape, holds no pattern, or holds a value other than 0 and 1.
pub fn read_patterns(spec: &str, raster: Raster) -> Result<Vec<Pattern>, InputError> {
    let found = match h5::split(spec) {
        Some((path, dataset)) => read_patterns_of(Path::new(path), Some(dataset), raster),
        None => read_patterns_of(Path::new(spec), None, raster),
    };
    found.map_err(|refusal| InputError::new(format!("{spec}: {refusal}")).help(refusal.advice(raster)))
}

/// Reads the patterns of a file; of HDF5 those of a dataset.
///
/// # Errors
/// As [`read_patterns`].
pub fn read_patterns_of(path: &Path, dataset: Option<&str>, raster: Raster) -> Result<Vec<Pattern>, Refusal> {
    match dataset {
        Some(dataset) => check_file(path).and_then(|()| h5::read(path, dataset, raster)),
        None => read_plain(path, raster),
    }
}

fn read_plain(path: &Path, raster: Raster) -> Result<Vec<Pattern>, Refusal> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let read = match extension.to_ascii_lowercase().as_str() {
        "npy" => npy::read,
        "csv" => csv::read,
        "png" => png::read,
        "h5" | "hdf5" => {
            check_file(path)?;
            return Err(Refusal::new("an HDF5 file holds many datasets; none is named").help(h5::advice(path)));
        }
        "" => return Err(Refusal::new("no extension tells the format").help(FORMS)),
        other => return Err(Refusal::new(format!("`.{other}` is not a pattern format")).help(FORMS)),
    };
    check_file(path)?;
    read(path, raster)
}

/// A pipe or a device would block or never end, and has no size to check headers against.
fn check_file(path: &Path) -> Result<(), Refusal> {
    let metadata = fs::metadata(path).map_err(|e| Refusal::new(e.to_string()).help(FORMS))?;
    if !metadata.is_file() {
        return Err(Refusal::new("not a file").help(FORMS));
    }
    if metadata.len() == 0 {
        return Err(Refusal::new("the file is empty").help(FORMS));
    }
    Ok(())
}

/// Why a file is not patterns, and what would be.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct Refusal {
    what: String,
    help: Option<String>,
}

impl Refusal {
    pub(super) fn new(what: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            help: None,
        }
    }

    /// What would be, on a raster.
    #[must_use]
    pub fn advice(&self, raster: Raster) -> String {
        let usual = || format!("a pattern has {raster} cells, each 0 (bare) or 1 (electrode)");
        self.help.clone().unwrap_or_else(usual)
    }

    pub(super) fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// The file's bytes, of which there may be at most `limit`.
pub(super) fn bytes(path: &Path, limit: u64) -> Result<Vec<u8>, Refusal> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(limit + 1).read_to_end(&mut bytes))
        .map_err(|e| Refusal::new(e.to_string()))?;
    if bytes.len() as u64 > limit {
        return Err(Refusal::new(format!("the file has more than {limit} bytes")));
    }
    Ok(bytes)
}

/// How many patterns an array of this shape holds.
pub(super) fn count(shape: &[u64], raster: Raster) -> Result<usize, Refusal> {
    let [columns, rows] = raster.sides().map(|side| side as u64);
    let n = match *shape {
        [y, x] if (y, x) == (rows, columns) => 1,
        [n, y, x] if (y, x) == (rows, columns) => n,
        _ => {
            return Err(Refusal::new(format!("the array has shape {}", shape_text(shape)))
                .help(format!("allowed: ({rows}, {columns}) or (n, {rows}, {columns})")));
        }
    };
    let most = (MOST_CELLS / raster.cells() as u64).clamp(1, MOST);
    match n {
        0 => Err(
            Refusal::new(format!("the array has shape {}: no pattern in it", shape_text(shape)))
                .help("allowed: n from 1"),
        ),
        n if n <= most => Ok(n as usize),
        _ => Err(Refusal::new(format!("{n} patterns in one argument")).help(format!("allowed: at most {most}"))),
    }
}

fn shape_text(shape: &[u64]) -> String {
    match shape {
        [one] => format!("({one},)"),
        _ => format!("({})", shape.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// The patterns that `values`, row by row from below, pattern after pattern, stand for.
pub(super) fn patterns(values: &[f64], raster: Raster) -> Result<Vec<Pattern>, Refusal> {
    patterns_from(values, raster, 0, values.len() > raster.cells())
}

/// The same of some patterns out of several, which begin at the pattern of that number.
pub(super) fn patterns_from(
    values: &[f64],
    raster: Raster,
    first: usize,
    several: bool,
) -> Result<Vec<Pattern>, Refusal> {
    let one = |(index, values): (usize, &[f64])| {
        let index = first + index;
        if let Some(at) = values.iter().position(|v| *v != 0.0 && *v != 1.0) {
            let place = if several { format!("[{index}]") } else { String::new() };
            return Err(Refusal::new(format!(
                "cell {place}[y={}][x={}] is {}",
                at / raster.columns(),
                at % raster.columns(),
                number(values[at])
            )));
        }
        let cells: Vec<u8> = values.iter().map(|v| u8::from(*v == 1.0)).collect();
        Pattern::from_cells(raster, &cells).map_err(|e| Refusal::new(e.to_string()))
    };
    values.chunks(raster.cells()).enumerate().map(one).collect()
}

/// A value as a person would write it; a double may have 300 digits.
fn number(value: f64) -> String {
    if value == 0.0 || (1e-5..1e15).contains(&value.abs()) || !value.is_finite() {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

#[cfg(test)]
mod fuzz;
#[cfg(test)]
pub(super) mod tests;
