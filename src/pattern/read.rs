//! Reads the pattern files named on the command line.
//!
//! Files must contain exactly the cells of the membrane, each 0, 1 or the number of an electrode group. Others are
//! rejected with the found value and its position, since a resampled, clipped or transposed pattern would give results
//! for another device. Files are not trusted: sizes are compared with the length of the file before memory is
//! allocated.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use super::raster::{Pattern, PatternForm, Raster, allowed_cells};
use super::{csv, h5, npy, png};
use deaflow_base::InputError;

/// Largest number of patterns in one argument; on 50 × 50 cells their fields take 830 MB.
const MOST: u64 = 20_000;

/// Largest number of cells in one argument.
pub(super) const MOST_CELLS: u64 = MOST * 2500;

const FORMS: &str = "allowed: FILE.npy, FILE.csv, FILE.png, FILE.h5:/dataset";

/// Reads the patterns of one `PATTERN` argument.
///
/// - `FILE.npy`: (rows, columns) or (n, rows, columns), booleans, integers or floats, C or Fortran order.
/// - `FILE.csv`: a line for each row; the first line is row y = 0, the lower edge, as `numpy.savetxt(…, delimiter=",")`
///   writes the array.
/// - `FILE.png`: a pixel, or a square block of equal pixels, per cell; dark = electrode; the top of the image is the
///   upper edge (largest y).
/// - `FILE.h5:/dataset` (or `.hdf5`): as `.npy`. Another process reads the file.
///
/// # Errors
/// When the file cannot be read, has another shape, contains no pattern, or has a value that is neither 0 nor an
/// electrode group.
pub fn read_patterns(spec: &str, form: PatternForm) -> Result<Vec<Pattern>, InputError> {
    let found = match h5::split(spec) {
        Some((path, dataset)) => read_patterns_of(Path::new(path), Some(dataset), form),
        None => read_patterns_of(Path::new(spec), None, form),
    };
    found.map_err(|refusal| InputError::new(format!("{spec}: {refusal}")).help(refusal.advice(form)))
}

/// Reads the patterns of a file; in an HDF5 file, those of a dataset.
///
/// # Errors
/// As [`read_patterns`].
pub fn read_patterns_of(
    path: &Path,
    dataset: Option<&str>,
    form: PatternForm,
) -> Result<Vec<Pattern>, PatternFileError> {
    match dataset {
        Some(dataset) => check_file(path).and_then(|()| h5::read(path, dataset, form)),
        None => read_plain(path, form),
    }
}

/// Reads a file with one pattern whose raster follows from the file: an image has a pixel per cell.
///
/// # Errors
/// When the file cannot be read, contains several patterns, or has a value other than 0 and 1.
pub fn read_mask(path: &Path) -> Result<Pattern, PatternFileError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let sides_of = match extension.to_ascii_lowercase().as_str() {
        "npy" => npy::sides,
        "csv" => csv::sides,
        "png" => png::sides,
        _ => return Err(PatternFileError::new("unknown mask format").help(MASKS)),
    };
    check_file(path)?;
    let [columns, rows] = sides_of(path)?;
    let raster = Raster::new(columns, rows).ok_or_else(|| {
        let most = Raster::MOST;
        PatternFileError::new(format!("it has {columns} × {rows} cells"))
            .help(format!("allowed: 1 to {most} along each side"))
    })?;
    let found = read_plain(path, PatternForm::bare_or_electrode(raster))?;
    match <[Pattern; 1]>::try_from(found) {
        Ok([one]) => Ok(one),
        Err(several) => {
            Err(PatternFileError::new(format!("the file has {} patterns, expected 1", several.len())).help(MASKS))
        }
    }
}

const MASKS: &str = "allowed: FILE.npy, FILE.csv, FILE.png, with one value per cell, 1 (or a dark pixel) inside";

fn read_plain(path: &Path, form: PatternForm) -> Result<Vec<Pattern>, PatternFileError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let read = match extension.to_ascii_lowercase().as_str() {
        "npy" => npy::read,
        "csv" => csv::read,
        "png" => png::read,
        "h5" | "hdf5" => {
            check_file(path)?;
            return Err(PatternFileError::new("the dataset of the HDF5 file is missing").help(h5::advice(path)));
        }
        "" => return Err(PatternFileError::new("the file name has no extension").help(FORMS)),
        other => return Err(PatternFileError::new(format!("cannot read `.{other}` files")).help(FORMS)),
    };
    check_file(path)?;
    read(path, form)
}

/// Rejects pipes and devices: they could block or never end, and have no size to compare headers with.
fn check_file(path: &Path) -> Result<(), PatternFileError> {
    let metadata = fs::metadata(path).map_err(|e| PatternFileError::new(e.to_string()).help(FORMS))?;
    if !metadata.is_file() {
        return Err(PatternFileError::new("not a file").help(FORMS));
    }
    if metadata.len() == 0 {
        return Err(PatternFileError::new("the file is empty").help(FORMS));
    }
    Ok(())
}

/// Why a file contains no patterns, and what is allowed.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct PatternFileError {
    what: String,
    help: Option<String>,
}

impl PatternFileError {
    pub(super) fn new(what: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            help: None,
        }
    }

    /// Returns what is allowed, if that does not depend on the pattern form.
    #[must_use]
    pub fn own_advice(&self) -> Option<&str> {
        self.help.as_deref()
    }

    /// Returns what is allowed for patterns of this form.
    #[must_use]
    pub fn advice(&self, form: PatternForm) -> String {
        let usual = || {
            format!(
                "a pattern has {} cells, each {}",
                form.raster,
                allowed_cells(form.groups)
            )
        };
        self.help.clone().unwrap_or_else(usual)
    }

    pub(super) fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// Reads a file of at most `limit` bytes.
pub(super) fn bytes(path: &Path, limit: u64) -> Result<Vec<u8>, PatternFileError> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(limit + 1).read_to_end(&mut bytes))
        .map_err(|e| PatternFileError::new(e.to_string()))?;
    if bytes.len() as u64 > limit {
        return Err(PatternFileError::new(format!("the file has more than {limit} bytes")));
    }
    Ok(bytes)
}

/// Returns the number of patterns in an array of this shape.
pub(super) fn count(shape: &[u64], form: PatternForm) -> Result<usize, PatternFileError> {
    let [columns, rows] = form.raster.sides().map(|side| side as u64);
    let n = match *shape {
        [y, x] if (y, x) == (rows, columns) => 1,
        [n, y, x] if (y, x) == (rows, columns) => n,
        _ => {
            return Err(
                PatternFileError::new(format!("the array has shape {}", shape_text(shape)))
                    .help(format!("allowed: ({rows}, {columns}) or (n, {rows}, {columns})")),
            );
        }
    };
    let most = (MOST_CELLS / form.raster.cells() as u64).clamp(1, MOST);
    match n {
        0 => Err(PatternFileError::new(format!(
            "the array has shape {} and contains no pattern",
            shape_text(shape)
        ))
        .help("allowed: n from 1")),
        n if n <= most => Ok(n as usize),
        _ => Err(PatternFileError::new(format!("found {n} patterns in one argument"))
            .help(format!("allowed: at most {most}"))),
    }
}

fn shape_text(shape: &[u64]) -> String {
    match shape {
        [one] => format!("({one},)"),
        _ => format!("({})", shape.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// Converts values, row by row from below and pattern after pattern, to patterns.
pub(super) fn patterns(values: &[f64], form: PatternForm) -> Result<Vec<Pattern>, PatternFileError> {
    patterns_from(values, form, 0, values.len() > form.raster.cells())
}

/// Converts the values of consecutive patterns, the first of which has the number `first`.
pub(super) fn patterns_from(
    values: &[f64],
    form: PatternForm,
    first: usize,
    several: bool,
) -> Result<Vec<Pattern>, PatternFileError> {
    let one = |(index, values): (usize, &[f64])| {
        let index = first + index;
        if let Some(at) = values.iter().position(|v| group(*v, form.groups).is_none()) {
            let place = if several { format!("[{index}]") } else { String::new() };
            return Err(PatternFileError::new(format!(
                "cell {place}[y={}][x={}] is {}",
                at / form.raster.columns(),
                at % form.raster.columns(),
                number(values[at])
            )));
        }
        let cells: Vec<u8> = values.iter().filter_map(|v| group(*v, form.groups)).collect();
        Pattern::of_form(form, &cells).map_err(|e| PatternFileError::new(e.to_string()))
    };
    values.chunks(form.raster.cells()).enumerate().map(one).collect()
}

/// Converts a value to the number of an electrode group, or 0.
fn group(value: f64, groups: usize) -> Option<u8> {
    let is_one = value.fract() == 0.0 && (0.0..=groups as f64).contains(&value);
    is_one.then_some(value as u8)
}

/// Formats a value shortly; a double may have 300 digits.
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
