//! Reads the patterns that a person names on the command line, whatever program wrote them.
//!
//! A file that is not exactly zeros and ones, or numbers of groups, on the cells of the membrane is refused with what was found and where: a solver fed a
//! resampled, clipped or transposed pattern would answer a question that nobody asked. Files are not trusted: sizes are
//! checked against what the file really holds before anything is allocated.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use super::raster::{Pattern, PatternForm, Raster, allowed_cells};
use super::{csv, h5, npy, png};
use deaflow_base::InputError;

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
/// When the file cannot be read, has another shape, holds no pattern, or holds a value that is neither 0 nor a group's number.
pub fn read_patterns(spec: &str, form: PatternForm) -> Result<Vec<Pattern>, InputError> {
    let found = match h5::split(spec) {
        Some((path, dataset)) => read_patterns_of(Path::new(path), Some(dataset), form),
        None => read_patterns_of(Path::new(spec), None, form),
    };
    found.map_err(|refusal| InputError::new(format!("{spec}: {refusal}")).help(refusal.advice(form)))
}

/// Reads the patterns of a file; of HDF5 those of a dataset.
///
/// # Errors
/// As [`read_patterns`].
pub fn read_patterns_of(path: &Path, dataset: Option<&str>, form: PatternForm) -> Result<Vec<Pattern>, Refusal> {
    match dataset {
        Some(dataset) => check_file(path).and_then(|()| h5::read(path, dataset, form)),
        None => read_plain(path, form),
    }
}

/// Reads the one pattern of a file that says itself how many cells there are: an image has a pixel for each.
///
/// # Errors
/// When it cannot be read, or holds several patterns or a value other than 0 and 1.
pub fn read_mask(path: &Path) -> Result<Pattern, Refusal> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let sides_of = match extension.to_ascii_lowercase().as_str() {
        "npy" => npy::sides,
        "csv" => csv::sides,
        "png" => png::sides,
        _ => return Err(Refusal::new("its extension tells no format of a mask").help(MASKS)),
    };
    check_file(path)?;
    let [columns, rows] = sides_of(path)?;
    let raster = Raster::new(columns, rows).ok_or_else(|| {
        let most = Raster::MOST;
        Refusal::new(format!("it has {columns} × {rows} cells")).help(format!("allowed: 1 to {most} along each side"))
    })?;
    let found = read_plain(path, PatternForm::bare_or_electrode(raster))?;
    match <[Pattern; 1]>::try_from(found) {
        Ok([one]) => Ok(one),
        Err(several) => Err(Refusal::new(format!("it holds {} patterns", several.len())).help(MASKS)),
    }
}

const MASKS: &str =
    "a mask is one of FILE.npy, FILE.csv, FILE.png, with one value for each cell, 1 (or a dark pixel) inside";

fn read_plain(path: &Path, form: PatternForm) -> Result<Vec<Pattern>, Refusal> {
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
    read(path, form)
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

    /// What would be, where that is known whatever the form.
    #[must_use]
    pub fn own_advice(&self) -> Option<&str> {
        self.help.as_deref()
    }

    /// What would be, of a form.
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
pub(super) fn count(shape: &[u64], form: PatternForm) -> Result<usize, Refusal> {
    let [columns, rows] = form.raster.sides().map(|side| side as u64);
    let n = match *shape {
        [y, x] if (y, x) == (rows, columns) => 1,
        [n, y, x] if (y, x) == (rows, columns) => n,
        _ => {
            return Err(Refusal::new(format!("the array has shape {}", shape_text(shape)))
                .help(format!("allowed: ({rows}, {columns}) or (n, {rows}, {columns})")));
        }
    };
    let most = (MOST_CELLS / form.raster.cells() as u64).clamp(1, MOST);
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
pub(super) fn patterns(values: &[f64], form: PatternForm) -> Result<Vec<Pattern>, Refusal> {
    patterns_from(values, form, 0, values.len() > form.raster.cells())
}

/// The same of some patterns out of several, which begin at the pattern of that number.
pub(super) fn patterns_from(
    values: &[f64],
    form: PatternForm,
    first: usize,
    several: bool,
) -> Result<Vec<Pattern>, Refusal> {
    let one = |(index, values): (usize, &[f64])| {
        let index = first + index;
        if let Some(at) = values.iter().position(|v| group(*v, form.groups).is_none()) {
            let place = if several { format!("[{index}]") } else { String::new() };
            return Err(Refusal::new(format!(
                "cell {place}[y={}][x={}] is {}",
                at / form.raster.columns(),
                at % form.raster.columns(),
                number(values[at])
            )));
        }
        let cells: Vec<u8> = values.iter().filter_map(|v| group(*v, form.groups)).collect();
        Pattern::of_form(form, &cells).map_err(|e| Refusal::new(e.to_string()))
    };
    values.chunks(form.raster.cells()).enumerate().map(one).collect()
}

/// The number of a group, or 0, that a value is.
fn group(value: f64, groups: usize) -> Option<u8> {
    let is_one = value.fract() == 0.0 && (0.0..=groups as f64).contains(&value);
    is_one.then_some(value as u8)
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
