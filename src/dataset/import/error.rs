//! Why a file is no dataset.

use super::{MOST, of_field, of_pattern};
use crate::Device;
use deaflow_pattern::allowed_cells;

/// Why a file is not taken as patterns with fields.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// No format that is read.
    #[error("`.{0}` is not a format of patterns with displacements")]
    Extension(String),
    /// The system, or what reads the format, refused it.
    #[error("{0}")]
    Unreadable(String),
    /// An array is not there; what is.
    #[error("there is no `{name}`, only {}", listed(.there))]
    Missing {
        /// The array.
        name: &'static str,
        /// What there is.
        there: Vec<String>,
    },
    /// An array of another shape.
    #[error("`{name}` has the shape {}", shape(.found))]
    Shape {
        /// The array.
        name: &'static str,
        /// Its shape.
        found: Vec<u64>,
        /// That of a row.
        wanted: Vec<u64>,
    },
    /// Arrays of different lengths.
    #[error("there are {patterns} patterns and {fields} displacement fields")]
    Lengths {
        /// Patterns.
        patterns: u64,
        /// Fields.
        fields: u64,
    },
    /// No row.
    #[error("it has no rows")]
    Empty,
    /// Too many rows.
    #[error("it has {0} rows")]
    Rows(u64),
    /// More than is there.
    #[error("`{name}` is said to have {claimed} bytes, more than a file of {bytes} bytes holds")]
    Overlong {
        /// The array.
        name: &'static str,
        /// Bytes of its elements.
        claimed: u64,
        /// Bytes of the file.
        bytes: u64,
    },
    /// Elements that are no numbers.
    #[error("`{name}`: {why}")]
    Elements {
        /// The array.
        name: &'static str,
        /// What is wrong with them.
        why: String,
    },
    /// A unit other than mm.
    #[error("the attribute `units` of `displacement` is {0:?}")]
    Units(String),
    /// A row that is no simulation.
    #[error("row {row} is no simulation: its `outcome` is {outcome}")]
    Estimate {
        /// Which.
        row: usize,
        /// What it is.
        outcome: String,
    },
    /// A cell that is no group of electrodes.
    #[error("row {row}: `patterns` [y={y}][x={x}] is {found}")]
    Cell {
        /// Which row.
        row: usize,
        /// From below.
        y: usize,
        /// From the left.
        x: usize,
        /// What stands there.
        found: f64,
    },
    /// A displacement that is no number.
    #[error("row {row}: `displacement` [y={y}][x={x}] is {found}")]
    NotFinite {
        /// Which row.
        row: usize,
        /// From below.
        y: usize,
        /// From the left.
        x: usize,
        /// What stands there.
        found: f64,
    },
    /// A corner of the frame that moves.
    #[error("row {row}: the frame moves by {found_mm:.3e} mm at [y={y}][x={x}]")]
    Frame {
        /// Which row.
        row: usize,
        /// From below.
        y: usize,
        /// From the left.
        x: usize,
        /// How far.
        found_mm: f64,
    },
    /// A displacement out of the membrane.
    #[error("row {row}: `displacement` [y={y}][x={x}] is {found_mm} mm on a membrane of {size}")]
    Far {
        /// Which row.
        row: usize,
        /// From below.
        y: usize,
        /// From the left.
        x: usize,
        /// How far.
        found_mm: f64,
        /// The sides of the membrane.
        size: String,
    },
    /// Columns of other names.
    #[error("its columns are {0}")]
    Columns(String),
    /// A line of separated values.
    #[error("line {line}: {why}")]
    Line {
        /// From 1.
        line: u64,
        /// What is wrong with it.
        why: String,
    },
    /// A sample without all corners.
    #[error("sample {sample} has no line for the corner x = {x_mm} mm, y = {y_mm} mm")]
    Corner {
        /// Its number.
        sample: u64,
        /// The corner.
        x_mm: f64,
        /// The corner.
        y_mm: f64,
    },
}

impl ImportError {
    /// What to do about it, for rows of a device.
    #[must_use]
    pub fn help(&self, device: &Device) -> String {
        let raster = device.raster();
        let [columns, rows] = raster.corner_sides();
        match self {
            Self::Extension(_) => "allowed: FILE.npz, FILE.h5, FILE.hdf5, FILE.csv".to_owned(),
            Self::Unreadable(_) | Self::Overlong { .. } => {
                "it is cut off, damaged or something else; write it again".to_owned()
            }
            Self::Missing { .. } => format!(
                "needed: `patterns` {} of {}, and `displacement` {} in mm",
                of_rows(&of_pattern(raster)),
                numbers(device, "and"),
                of_rows(&of_field(raster))
            ),
            Self::Shape { wanted, .. } => format!("allowed: {}", of_rows(wanted)),
            Self::Lengths { .. } => "each pattern has one field, in the same order".to_owned(),
            Self::Empty | Self::Rows(_) => format!("allowed: 1 to {MOST} rows"),
            Self::Elements { .. } => {
                "allowed: booleans, integers and floats in C or Fortran order, as numpy.savez writes them".to_owned()
            }
            Self::Units(_) => "displacements are taken in mm: convert them, and say so by `units`".to_owned(),
            Self::Estimate { .. } => "labels that a model learns from have to be simulated or measured".to_owned(),
            Self::Cell { .. } => format!("a cell is {}", allowed_cells(device.groups)),
            Self::NotFinite { .. } => {
                format!("leave out what has no displacement: a row has one at each of its {columns} × {rows} corners")
            }
            Self::Frame { .. } => {
                "the membrane is clamped: its edges and its frame stay where they are, but for 1e-6 mm of rounding"
                    .to_owned()
            }
            Self::Far { .. } => "displacements are taken in mm: divide µm by 1000, multiply m by 1000".to_owned(),
            Self::Columns(_) => format!("the first line is {}", super::csv::COLUMNS.join(",")),
            Self::Line { .. } | Self::Corner { .. } => format!(
                "a sample has a line for each of its {columns} × {rows} corners; `electrode` is {} of the cell to the upper right, empty on \
                 the right and upper edges",
                numbers(device, "or")
            ),
        }
    }
}

/// What a cell of a device's pattern may be.
fn numbers(device: &Device, and: &str) -> String {
    match device.groups {
        1 => format!("0 {and} 1"),
        groups => format!("0 to {groups}"),
    }
}

/// The shape of rows of these extents.
fn of_rows(extents: &[u64]) -> String {
    let row: Vec<String> = extents.iter().map(u64::to_string).collect();
    format!("(n, {})", row.join(", "))
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

/// At most a dozen names.
fn listed(names: &[String]) -> String {
    let shown: Vec<&str> = names.iter().take(12).map(String::as_str).collect();
    match shown.is_empty() {
        true => "nothing".to_owned(),
        false => shown.join(", "),
    }
}
