//! What an audit reads: rows by ranges, so that a dataset need not fit into memory, and columns of one value per row.

use std::ops::Range;

use super::claims::{Families, Origin};
use super::error::AuditError;
use crate::{Bins, Device};
use deaflow_field::Mesh;

/// Rows as they stand in the file: nothing is known of them yet.
pub struct Batch {
    /// Cells, row by row.
    pub cells: Vec<f64>,
    /// Displacements in mm, two for each corner of cells.
    pub displacement: Vec<f64>,
}

/// Gives rows.
pub trait RowSource: Sync {
    /// The rows of a range.
    ///
    /// # Errors
    /// When they cannot be read.
    fn read(&self, range: Range<usize>) -> Result<Batch, AuditError>;
}

/// One value per row each; what a dataset does not say is `None`.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    /// Part of the dataset.
    pub split: Option<Vec<String>>,
    /// Family that the pattern was drawn from.
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
    /// The sample that the row was made from; [`NO_NUMBER`] where it is no whole number.
    pub source: Option<Vec<u64>>,
    /// The symmetry that carries the sample to the row; likewise.
    pub symmetry: Option<Vec<u64>>,
    /// Bin of the largest displacement; likewise.
    pub bin: Option<Vec<u64>>,
}

/// Stands for what is no whole number, in columns of these.
pub const NO_NUMBER: u64 = u64::MAX;

impl Columns {
    /// Names and lengths of the columns that are there.
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

/// What is known of how the fields were found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Discretisation {
    /// On one mesh, by Newton's method.
    Mesh(Mesh),
    /// Each row on a mesh of its own (the column), by Newton's method.
    PerRow,
    /// Estimates on one mesh: no equilibria.
    Estimates(Mesh),
    /// Nothing.
    Unknown,
}

/// A dataset.
pub struct Dataset<'a> {
    /// The device that its rows are patterns and fields of.
    pub device: &'a Device,
    /// How many rows.
    pub len: usize,
    /// The rows.
    pub rows: &'a dyn RowSource,
    /// Their columns.
    pub columns: Columns,
    /// How the fields were found.
    pub declared: Discretisation,
    /// The samples that `source` counts, where they are at hand.
    pub origins: Option<&'a [Origin]>,
    /// The bins that `bin` counts, where they are known.
    pub bins: Option<Bins>,
    /// Tells what patterns a family has.
    pub families: &'a dyn Families,
}
