//! Reads the pattern files named on the command line.
//!
//! Files must contain exactly the cells of the membrane, each 0, 1 or the number of an electrode group. Others are
//! rejected with the found value and its position, since a clipped or transposed pattern would give results for another
//! device. Pictures are read by coverage, and masks of 0 and 255 as 0 and 1; a note says so. Files are not trusted:
//! sizes are compared with the length of the file before memory is allocated.

use std::fs;
use std::path::Path;

use super::drawing::{DrawingFormat, DrawingOptions};
use super::drawn::{self, Edges};
use super::file::{FilePatterns, PatternFileError};
use super::picture::{self, Greys, PictureFormat};
use super::raster::{Pattern, PatternForm, Raster};
use super::{array, csv};
use deaflow_array::{Format, extension, split};
use deaflow_base::InputError;

const FORMS: &str = "allowed: FILE.npy, FILE.csv (also .txt, .dat, .tsv), FILE.png (also .jpg, .tif, .bmp), FILE.dxf, \
                     FILE.svg, FILE.h5:/dataset (also .hdf5, .nc, .mat, .npz)";

/// What a file of patterns is, by its extension.
#[derive(Clone, Copy)]
enum FileKind {
    Array(Format),
    Table,
    Picture(PictureFormat),
    Drawing(DrawingFormat),
}

impl FileKind {
    fn of(path: &Path) -> Result<Self, PatternFileError> {
        if let Some(format) = Format::of(path) {
            return Ok(Self::Array(format));
        }
        let end = extension(path);
        // Of `FILE.npy:/x` it is that of the file.
        let names_dataset = path.extension().is_none_or(|own| !own.eq_ignore_ascii_case(&end));
        match end.as_str() {
            "npy" | "csv" | "txt" | "dat" | "tsv" | "asc" | "png" | "jpg" | "jpeg" | "tif" | "tiff" | "bmp" | "dxf"
            | "svg"
                if names_dataset =>
            {
                Err(PatternFileError::new(format!("`.{end}` files have no named datasets"))
                    .help("name the file alone, without `:/…`"))
            }
            "csv" | "txt" | "dat" | "tsv" | "asc" => Ok(Self::Table),
            "dxf" => Ok(Self::Drawing(DrawingFormat::Dxf)),
            "svg" => Ok(Self::Drawing(DrawingFormat::Svg)),
            "" => Err(PatternFileError::new("the file name has no extension").help(FORMS)),
            other => PictureFormat::named(other)
                .map(Self::Picture)
                .ok_or_else(|| PatternFileError::new(format!("cannot read `.{other}` files")).help(FORMS)),
        }
    }
}

/// Whether a file is one of patterns, by its extension.
#[must_use]
pub fn has_patterns(path: &Path) -> bool {
    FileKind::of(path).is_ok()
}

/// Reads the patterns of one `PATTERN` argument.
///
/// - `FILE.npy`: (rows, columns) or (n, rows, columns), booleans, integers or floats, C or Fortran order.
/// - `FILE.csv`, `.txt`, `.dat`, `.tsv`: a line for each row; the first line is row y = 0, the lower edge, as
///   `numpy.savetxt` writes the array.
/// - `FILE.png`, `.jpg`, `.tif`, `.bmp`: dark = electrode; the top of the image is the upper edge (largest y). A pixel,
///   or a block of pixels, per cell; an image of another size, or with greys, by the share of each cell that is dark.
/// - `FILE.dxf`, `FILE.svg`: cells whose centre lies in the closed curves of a layer, in DXF, or in filled areas, in
///   SVG.
/// - `FILE.h5:/dataset` (also `.hdf5`, `.nc`, `.mat`, `.npz`): as `.npy`. Another process reads HDF5. Without a name,
///   the only array with the shape of patterns.
///
/// # Errors
/// When the file cannot be read, has another shape, contains no pattern, or has a value that is neither 0 nor an
/// electrode group.
pub fn read_patterns(spec: &str, form: PatternForm, drawings: &DrawingOptions) -> Result<FilePatterns, InputError> {
    let (path, dataset) = parts(spec);
    let found = read_patterns_of(path, dataset, form, drawings);
    found.map_err(|refusal| InputError::new(format!("{spec}: {refusal}")).help(refusal.advice(form)))
}

/// Splits an argument into the file and the dataset in it.
fn parts(spec: &str) -> (&Path, Option<&str>) {
    match split(spec) {
        Some((path, dataset)) => (Path::new(path), Some(dataset)),
        None => (Path::new(spec), None),
    }
}

/// Reads the patterns of a file; in a file with named arrays, those of a dataset.
///
/// # Errors
/// As [`read_patterns`].
pub fn read_patterns_of(
    path: &Path,
    dataset: Option<&str>,
    form: PatternForm,
    drawings: &DrawingOptions,
) -> Result<FilePatterns, PatternFileError> {
    let kind = FileKind::of(path)?;
    check_file(path)?;
    match kind {
        FileKind::Drawing(format) => drawn::read(path, format, form, drawings),
        _ if drawings.edges == Edges::Fitted => Err(drawn::no_shapes()),
        FileKind::Picture(format) if drawings.edges == Edges::Coverage => picture::read_shares(path, format, form),
        _ if drawings.edges == Edges::Coverage => Err(drawn::no_shares()),
        _ => read(path, kind, dataset, form, Greys::Covered, drawings.threshold),
    }
}

fn read(
    path: &Path,
    kind: FileKind,
    dataset: Option<&str>,
    form: PatternForm,
    greys: Greys,
    threshold: f64,
) -> Result<FilePatterns, PatternFileError> {
    match kind {
        FileKind::Drawing(_) => Err(drawn::no_cells()),
        FileKind::Array(format) => array::read(path, format, dataset, form),
        FileKind::Table => csv::read(path, form),
        FileKind::Picture(format) => picture::read(path, format, form, greys, threshold),
    }
}

/// Returns the form of the patterns of an argument, as the file has it: an image has a pixel per cell and one group.
///
/// # Errors
/// When the file cannot be read, or has too many cells.
pub fn form_of(spec: &str) -> Result<PatternForm, InputError> {
    let (path, dataset) = parts(spec);
    let refused = |refusal: PatternFileError| {
        let error = InputError::new(format!("{spec}: {refusal}"));
        match refusal.own_advice() {
            Some(help) => error.help(help),
            None => error,
        }
    };
    let (kind, sides) = sides_of(path, dataset).map_err(refused)?;
    let raster = raster_of(sides).map_err(|refusal| {
        let help = format!(
            "allowed: 1 to {} along each side; name the scene, which gives the cells",
            Raster::MOST
        );
        refused(refusal.help(help))
    })?;
    Ok(match kind {
        FileKind::Picture(_) | FileKind::Drawing(_) => PatternForm::bare_or_electrode(raster),
        FileKind::Array(_) | FileKind::Table => PatternForm::of_square_cells(raster, Pattern::MOST_GROUPS),
    })
}

/// Returns the numbers of columns and rows in a file.
fn sides_of(path: &Path, dataset: Option<&str>) -> Result<(FileKind, [usize; 2]), PatternFileError> {
    let kind = FileKind::of(path)?;
    check_file(path)?;
    let sides = match kind {
        FileKind::Array(format) => array::sides(path, format, dataset)?,
        FileKind::Table => csv::sides(path)?,
        FileKind::Picture(format) => picture::sides(path, format)?,
        FileKind::Drawing(_) => return Err(drawn::no_cells()),
    };
    Ok((kind, sides))
}

fn raster_of([columns, rows]: [usize; 2]) -> Result<Raster, PatternFileError> {
    Raster::new(columns, rows).ok_or_else(|| {
        let most = Raster::MOST;
        PatternFileError::new(format!("it has {columns} × {rows} cells"))
            .help(format!("allowed: 1 to {most} along each side"))
    })
}

/// Reads a file with one pattern whose raster follows from the file: an image has a pixel per cell.
///
/// # Errors
/// When the file cannot be read, contains several patterns, or has a value other than 0 and 1.
pub fn read_mask(path: &Path) -> Result<Pattern, PatternFileError> {
    let (kind, sides) = sides_of(path, None)?;
    let raster = raster_of(sides)?;
    let found = read(
        path,
        kind,
        None,
        PatternForm::bare_or_electrode(raster),
        Greys::Refused,
        picture::HALF,
    )?;
    match <[Pattern; 1]>::try_from(found.patterns) {
        Ok([one]) => Ok(one),
        Err(several) => {
            Err(PatternFileError::new(format!("the file has {} patterns, expected 1", several.len())).help(MASKS))
        }
    }
}

const MASKS: &str = "allowed: a file of patterns with one value per cell, 1 (or a dark pixel) inside";

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
pub(super) mod fuzz;
#[cfg(test)]
pub(super) mod tests;
