//! An array in a file.

use std::ops::Range;
use std::path::PathBuf;

use super::error::ArrayError;
use super::numpy::Member;
use deaflow_hdf::{DatasetInfo, Element, HdfFile};

/// What elements may be.
const TYPES: &str = "allowed: booleans, integers, enumerations and floats";

/// The note on an array of MATLAB.
const REVERSED: &str = "axes in MATLAB's order, reversed";

/// An array in a file.
pub struct Array {
    pub(super) path: PathBuf,
    pub(super) name: String,
    pub(super) source: Source,
}

pub(super) enum Source {
    Numpy(Member),
    Hdf5(DatasetInfo),
}

impl Array {
    /// Returns the extents, slowest first.
    #[must_use]
    pub fn shape(&self) -> &[u64] {
        match &self.source {
            Source::Numpy(member) => &member.header.shape,
            Source::Hdf5(found) => &found.shape,
        }
    }

    /// Returns what the reader did that a user should know.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let Source::Hdf5(found) = &self.source else {
            return Vec::new();
        };
        let reversed = found.is_reversed.then(|| REVERSED.to_owned());
        let unpacked = found
            .packing
            .map(|[factor, offset]| format!("values unpacked: times {factor}, plus {offset}"));
        reversed.into_iter().chain(unpacked).collect()
    }

    /// Checks that the elements are numbers, and for NumPy that the file has as many as the shape says and that their
    /// checksum is right. The caller checks the shape first, so that no more is unpacked than it allows.
    ///
    /// # Errors
    /// When they are not.
    pub fn check(&self) -> Result<(), ArrayError> {
        match &self.source {
            Source::Numpy(member) => member.check(&self.path),
            Source::Hdf5(found) => match &found.element {
                element if element.is_number() => Ok(()),
                Element::Other(what) => Err(ArrayError::new(format!("elements of type {what}"), TYPES).of(&self.name)),
                _ => Err(ArrayError::new("elements of type text", TYPES).of(&self.name)),
            },
        }
    }

    /// Reads rows along the first axis, in C order.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn rows(&self, rows: Range<usize>) -> Result<Vec<f64>, ArrayError> {
        match &self.source {
            Source::Numpy(member) => member.rows(&self.path, rows),
            Source::Hdf5(_) => Ok(HdfFile::open_untrusted(&self.path)?.numbers(&self.name, rows)?),
        }
    }
}
