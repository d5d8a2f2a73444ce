//! Patterns with displacement fields that were made elsewhere: measured, or simulated by another program.
//!
//! The readers check the shapes, the sizes and every number of a file before they use them. An error names the row and
//! the position of the wrong value.

mod arrays;
mod csv;
mod error;
mod help;
mod rows;
mod shape;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use arrays::Arrays;
use deaflow_array::{Format, extension};

use crate::Device;

pub use error::ImportError;
pub use rows::Rows;
pub use shape::MAX_ROWS;

/// An imported file whose array shapes are checked.
pub struct ImportFile {
    content: Content,
    device: Arc<Device>,
}

/// The open file.
enum Content {
    Arrays(Box<Arrays>),
    /// All rows: a CSV file may list them in any order.
    Csv(Rows),
}

impl ImportFile {
    /// Opens a file of patterns and fields of a device: FILE.npz, FILE.h5, FILE.hdf5, FILE.nc, FILE.mat, or a table.
    ///
    /// # Errors
    /// When the file cannot be read, lacks an array, or has arrays of the wrong shape.
    pub fn open(path: &Path, device: &Arc<Device>) -> Result<Self, ImportError> {
        let extension = extension(path);
        let content = match (Format::of(path).filter(|format| format.has_names()), extension.as_str()) {
            (Some(format), _) => Content::Arrays(Box::new(Arrays::open(path, format, device.raster())?)),
            (None, "csv" | "txt" | "dat" | "tsv") => Content::Csv(csv::read(path, device)?),
            (None, _) => return Err(ImportError::Extension(extension)),
        };
        let device = Arc::clone(device);
        Ok(Self { content, device })
    }

    /// Returns the number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        match &self.content {
            Content::Arrays(file) => file.len(),
            Content::Csv(rows) => rows.len(),
        }
    }

    /// Returns what the reader did that a user should know.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        match &self.content {
            Content::Arrays(file) => file.notes(),
            Content::Csv(_) => Vec::new(),
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
        match &self.content {
            Content::Arrays(file) => file.scene(),
            Content::Csv(_) => None,
        }
    }

    /// Reads a range of rows and checks every number in them.
    ///
    /// # Errors
    /// When the rows cannot be read, or one of them is not a pattern with a field of a clamped membrane.
    pub fn rows(&self, range: Range<usize>) -> Result<Rows, ImportError> {
        let (cells, displacement) = match &self.content {
            Content::Arrays(file) => file.numbers(range.clone())?,
            Content::Csv(rows) => return Ok(rows.part(range)),
        };
        Rows::new(&cells, displacement, range.start, &self.device)
    }
}
