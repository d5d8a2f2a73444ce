//! Errors of an import.

use deaflow_array::ArrayError;
use deaflow_base::{TableError, listed};

/// Why a file cannot be imported as patterns with fields.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The file extension is unknown.
    #[error("cannot import files of format `.{0}`")]
    Extension(String),
    /// The system reported an error.
    #[error("{0}")]
    Unreadable(String),
    /// The reader of arrays reported an error.
    #[error(transparent)]
    Array(#[from] ArrayError),
    /// The reader of tables reported an error.
    #[error(transparent)]
    Table(#[from] TableError),
    /// An array is missing.
    #[error("array `{name}` is missing; the file has {}", listed(.there))]
    Missing {
        /// Name of the array.
        name: &'static str,
        /// Names of the arrays in the file.
        there: Vec<String>,
    },
    /// An array has the wrong shape.
    #[error("`{name}` has the shape {}", shape(.found))]
    Shape {
        /// Name of the array.
        name: &'static str,
        /// Its shape.
        found: Vec<u64>,
        /// The extents of a row.
        expected: Vec<u64>,
    },
    /// The arrays differ in length.
    #[error("there are {patterns} patterns and {fields} displacement fields")]
    Lengths {
        /// Number of patterns.
        patterns: u64,
        /// Number of fields.
        fields: u64,
    },
    /// The file has no rows.
    #[error("the file has no rows")]
    Empty,
    /// The file has too many rows.
    #[error("the file has {0} rows")]
    Rows(u64),
    /// An array claims more bytes than the file can hold.
    #[error("`{name}` claims {claimed} bytes, but a file of {bytes} bytes cannot hold them")]
    Overlong {
        /// Name of the array.
        name: &'static str,
        /// Bytes of its elements.
        claimed: u64,
        /// Bytes of the file.
        bytes: u64,
    },
    /// The unit is not mm.
    #[error("attribute `units` of `displacement` is {0:?}")]
    Units(String),
    /// A row is an estimate or a prediction.
    #[error("row {row} is not simulated: its `outcome` is {outcome}")]
    Estimate {
        /// Number of the row.
        row: usize,
        /// Its outcome.
        outcome: String,
    },
    /// A cell is not the number of an electrode group.
    #[error("row {row}: `patterns` [y={y}][x={x}] is {found}")]
    Cell {
        /// Number of the row.
        row: usize,
        /// Index along y.
        y: usize,
        /// Index along x.
        x: usize,
        /// Value found.
        found: f64,
    },
    /// A displacement is not finite.
    #[error("row {row}: `displacement` [y={y}][x={x}] is {found}")]
    NotFinite {
        /// Number of the row.
        row: usize,
        /// Index along y.
        y: usize,
        /// Index along x.
        x: usize,
        /// Value found.
        found: f64,
    },
    /// A corner on the frame moves.
    #[error("row {row}: the frame moves by {found_mm:.3e} mm at [y={y}][x={x}]")]
    Frame {
        /// Number of the row.
        row: usize,
        /// Index along y.
        y: usize,
        /// Index along x.
        x: usize,
        /// Displacement in mm.
        found_mm: f64,
    },
    /// A displacement exceeds the size of the membrane.
    #[error("row {row}: `displacement` [y={y}][x={x}] is {found_mm} mm on a membrane of {size}")]
    Far {
        /// Number of the row.
        row: usize,
        /// Index along y.
        y: usize,
        /// Index along x.
        x: usize,
        /// Displacement in mm.
        found_mm: f64,
        /// Size of the membrane.
        size: String,
    },
    /// A line is wrong.
    #[error("line {line}: {why}")]
    Line {
        /// Line number, from 1.
        line: u64,
        /// What is wrong.
        why: String,
    },
    /// A sample lacks a corner.
    #[error("sample {sample} has no line for the corner x = {x_mm} mm, y = {y_mm} mm")]
    Corner {
        /// Number of the sample.
        sample: u64,
        /// x of the corner.
        x_mm: f64,
        /// y of the corner.
        y_mm: f64,
    },
}

impl ImportError {
    /// Whether the file may be one of patterns without fields.
    #[must_use]
    pub fn has_no_fields(&self) -> bool {
        matches!(
            self,
            Self::Extension(_) | Self::Missing { .. } | Self::Table(TableError::Columns { .. })
        )
    }
}

fn shape(extents: &[u64]) -> String {
    match extents {
        [one] => format!("({one},)"),
        _ => format!(
            "({})",
            extents.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")
        ),
    }
}
