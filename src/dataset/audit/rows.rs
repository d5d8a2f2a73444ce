//! The input of an audit: ranges of rows, so that a dataset need not fit into memory, and columns with one value per
//! row.

use std::ops::Range;

use super::error::AuditError;
use crate::{Bins, Device};
use deaflow_base::Digest;
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;

/// Unchecked rows of a file.
pub struct Batch {
    /// Cells, row by row.
    pub cells: Vec<f64>,
    /// Displacements in mm, two for each corner of cells.
    pub displacement: Vec<f64>,
}

/// Reads rows.
pub trait RowSource: Sync {
    /// Reads a range of rows.
    ///
    /// # Errors
    /// When they cannot be read.
    fn read(&self, range: Range<usize>) -> Result<Batch, AuditError>;
}

/// Columns with one value per row. Columns that the dataset does not have are `None`.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    /// Split.
    pub split: Option<Vec<String>>,
    /// Family of the pattern.
    pub family: Option<Vec<String>>,
    /// Whether the row claims to have a field.
    pub has_field: Option<Vec<bool>>,
    /// Largest displacement magnitude in mm.
    pub peak: Option<Vec<f64>>,
    /// Digest of the orbit.
    pub orbit: Option<Vec<String>>,
    /// The mesh of each row.
    pub mesh: Option<Vec<Mesh>>,
    /// Estimated largest error in mm.
    pub error: Option<Vec<f64>>,
    /// The sample of the row; [`NO_NUMBER`] if the value is not a whole number.
    pub source: Option<Vec<u64>>,
    /// The symmetry that maps the sample to the row, or [`NO_NUMBER`].
    pub symmetry: Option<Vec<u64>>,
    /// Bin of the largest displacement, or [`NO_NUMBER`].
    pub bin: Option<Vec<u64>>,
}

/// Replaces values that are not whole numbers.
pub const NO_NUMBER: u64 = u64::MAX;

impl Columns {
    /// Returns names and lengths of the columns of the dataset.
    #[must_use]
    pub fn lengths(&self) -> Vec<(&'static str, usize)> {
        fn length<T>(name: &'static str, column: &Option<Vec<T>>) -> Option<(&'static str, usize)> {
            column.as_ref().map(|values| (name, values.len()))
        }
        let all = [
            length("split", &self.split),
            length("family", &self.family),
            length("outcome", &self.has_field),
            length("max_displacement", &self.peak),
            length("orbit", &self.orbit),
            length("elements_per_cell", &self.mesh),
            length("discretisation_error", &self.error),
            length("source", &self.source),
            length("symmetry", &self.symmetry),
            length("bin", &self.bin),
        ];
        all.into_iter().flatten().collect()
    }
}

/// The mesh and the method of the fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Discretisation {
    /// Newton's method on one mesh.
    Mesh(Mesh),
    /// Newton's method on the mesh of each row in the column `mesh`.
    PerRow,
    /// Estimates on one mesh, which are not equilibria.
    Estimates(Mesh),
    /// Unknown.
    Unknown,
}

/// Checks whether a pattern can belong to a family.
pub trait Families: Sync {
    /// Returns whether the family may contain the pattern; `None` for an unknown family.
    fn admits(&self, family: &str, pattern: &Pattern) -> Option<bool>;
}

/// A sample from which rows were made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceSample {
    /// Digest of its pattern.
    pub pattern: Digest,
    /// Its family.
    pub family: String,
}

/// A dataset.
pub struct Dataset<'a> {
    /// The device.
    pub device: &'a Device,
    /// Number of rows.
    pub len: usize,
    /// The rows.
    pub rows: &'a dyn RowSource,
    /// The columns.
    pub columns: Columns,
    /// The declared mesh and method of the fields.
    pub declared: Discretisation,
    /// The samples to which `source` refers, if they are available.
    pub source_samples: Option<&'a [SourceSample]>,
    /// The bins to which `bin` refers, if they are known.
    pub bins: Option<Bins>,
    /// The families.
    pub families: &'a dyn Families,
}
