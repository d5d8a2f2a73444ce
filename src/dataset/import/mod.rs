//! Patterns with displacement fields that were made elsewhere: measured, or simulated by another program.
//!
//! The readers check the shapes, the sizes and every number of a file before they use them. An error names the row and
//! the position of the wrong value.

mod csv;
mod error;
mod hdf;
mod help;
mod npz;
mod rows;
mod shape;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use npz::Npz;

use crate::Device;

pub use error::ImportError;
pub use rows::Rows;
pub use shape::MAX_ROWS;

/// An imported file whose array shapes are checked.
pub struct ImportFile {
    format: Format,
    device: Arc<Device>,
}

/// The open file, by format.
enum Format {
    Npz(Npz),
    Hdf(hdf::Hdf),
    /// All rows: a CSV file may list them in any order.
    Csv(Rows),
}

impl ImportFile {
    /// Opens a file of patterns and fields of a device: FILE.npz, FILE.h5, FILE.hdf5 or FILE.csv.
    ///
    /// # Errors
    /// When the file cannot be read, lacks an array, or has arrays of the wrong shape.
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

    /// Returns the number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        match &self.format {
            Format::Npz(file) => file.len(),
            Format::Hdf(file) => file.len(),
            Format::Csv(rows) => rows.len(),
        }
    }

    /// Returns whether the file has no rows; `open` refuses such a file.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the scene that the file names as the origin of its fields; only HDF5 files written by deaflow do.
    #[must_use]
    pub fn scene(&self) -> Option<&str> {
        match &self.format {
            Format::Hdf(file) => file.scene(),
            Format::Npz(_) | Format::Csv(_) => None,
        }
    }

    /// Reads a range of rows and checks every number in them.
    ///
    /// # Errors
    /// When the rows cannot be read, or one of them is not a pattern with a field of a clamped membrane.
    pub fn rows(&self, range: Range<usize>) -> Result<Rows, ImportError> {
        let (cells, displacement) = match &self.format {
            Format::Npz(file) => file.numbers(range.clone())?,
            Format::Hdf(file) => file.numbers(range.clone())?,
            Format::Csv(rows) => return Ok(rows.part(range)),
        };
        Rows::new(&cells, displacement, range.start, &self.device)
    }
}
