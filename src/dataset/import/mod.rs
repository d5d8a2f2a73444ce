//! Patterns with displacement fields that were made elsewhere: measured, or simulated by another program.
//!
//! Nothing in such a file is taken on trust: its shapes, its sizes and every number in it are checked before anything is made of
//! them, and what is wrong is named by row and place.

mod csv;
mod error;
mod hdf;
mod npz;
mod rows;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use npz::Npz;

use super::Device;
use deaflow_pattern::Raster;

pub use error::ImportError;
pub use rows::Rows;

/// The most rows of a file, and of several together.
pub const MOST: usize = 100_000;

/// What the arrays are called.
const PATTERNS: &str = "patterns";
const DISPLACEMENT: &str = "displacement";

/// A file whose shapes have been looked at.
pub struct ImportFile {
    format: Format,
    device: Arc<Device>,
}

/// How its rows are stored.
enum Format {
    Npz(Npz),
    Hdf(hdf::Hdf),
    /// All of them, since they may stand in any order.
    Csv(Rows),
}

impl ImportFile {
    /// Looks at a file of patterns and fields of a device: FILE.npz, FILE.h5, FILE.hdf5 or FILE.csv.
    ///
    /// # Errors
    /// When it cannot be read, lacks an array, or has arrays of other shapes.
    pub fn open(path: &Path, device: &Arc<Device>) -> Result<Self, ImportError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        let format = match extension.to_ascii_lowercase().as_str() {
            "npz" => Format::Npz(Npz::open(path, device.raster())?),
            "h5" | "hdf5" => Format::Hdf(hdf::Hdf::open(path, device.raster())?),
            "csv" => Format::Csv(csv::read(path, device)?),
            other => return Err(ImportError::Extension(other.to_owned())),
        };
        let device = Arc::clone(device);
        Ok(Self { format, device })
    }

    /// How many rows it has.
    #[must_use]
    pub fn len(&self) -> usize {
        match &self.format {
            Format::Npz(file) => file.len(),
            Format::Hdf(file) => file.len(),
            Format::Csv(rows) => rows.len(),
        }
    }

    /// Whether it has none; such a file is refused.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The scene that it says its fields were made with, as the files of this program do.
    #[must_use]
    pub fn scene(&self) -> Option<&str> {
        match &self.format {
            Format::Hdf(file) => file.scene(),
            Format::Npz(_) | Format::Csv(_) => None,
        }
    }

    /// Some of its rows, every number of them checked.
    ///
    /// # Errors
    /// When they cannot be read, or hold what is no pattern or no field of a clamped membrane; with the row.
    pub fn rows(&self, range: Range<usize>) -> Result<Rows, ImportError> {
        let (cells, displacement) = match &self.format {
            Format::Npz(file) => file.numbers(range.clone())?,
            Format::Hdf(file) => file.numbers(range.clone())?,
            Format::Csv(rows) => return Ok(rows.part(range)),
        };
        Rows::new(&cells, displacement, range.start, &self.device)
    }
}

/// The extents of a row of patterns.
fn of_pattern(raster: Raster) -> [u64; 2] {
    let [columns, rows] = raster.sides().map(|side| side as u64);
    [rows, columns]
}

/// The extents of a row of displacements.
fn of_field(raster: Raster) -> [u64; 3] {
    let [columns, rows] = raster.corner_sides().map(|side| side as u64);
    [rows, columns, 2]
}

/// How many rows arrays of two shapes have.
fn count(patterns: &[u64], displacement: &[u64], raster: Raster) -> Result<usize, ImportError> {
    let rows = |name: &'static str, row: &[u64], shape: &[u64]| match shape.split_first() {
        Some((n, rest)) if rest == row => Ok(*n),
        _ => Err(ImportError::Shape {
            name,
            found: shape.to_vec(),
            wanted: row.to_vec(),
        }),
    };
    let patterns = rows(PATTERNS, &of_pattern(raster), patterns)?;
    let fields = rows(DISPLACEMENT, &of_field(raster), displacement)?;
    match (patterns, fields) {
        (0, 0) => Err(ImportError::Empty),
        (patterns, fields) if patterns != fields => Err(ImportError::Lengths { patterns, fields }),
        (rows, _) if rows > MOST as u64 => Err(ImportError::Rows(rows)),
        (rows, _) => Ok(rows as usize),
    }
}
