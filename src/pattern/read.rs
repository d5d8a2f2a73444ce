//! Reads the pattern files named on the command line.
//!
//! Files must contain exactly the cells of the membrane, each 0, 1 or the number of an electrode group. Others are
//! rejected with the found value and its position, since a resampled, clipped or transposed pattern would give results
//! for another device. Files are not trusted: sizes are compared with the length of the file before memory is
//! allocated.

use std::fs;
use std::path::Path;

use super::file::PatternFileError;
use super::raster::{Pattern, PatternForm, Raster};
use super::{csv, h5, npy, png};
use deaflow_base::InputError;

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

#[cfg(test)]
mod fuzz;
#[cfg(test)]
pub(super) mod tests;
