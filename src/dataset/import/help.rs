//! Advice for each error of an import.

use super::csv::COLUMNS;
use super::error::ImportError;
use super::shape::{MAX_ROWS, field_extents, pattern_extents};
use crate::Device;
use deaflow_base::TableError;
use deaflow_pattern::allowed_cells;

impl ImportError {
    /// Returns advice on how to correct the file, for rows of a device.
    #[must_use]
    pub fn help(&self, device: &Device) -> String {
        let raster = device.raster();
        let [columns, rows] = raster.corner_sides();
        match self {
            Self::Extension(_) => {
                "allowed: FILE.npz, FILE.h5 (also .hdf5, .nc, .mat), FILE.csv (also .txt, .dat, .tsv)".to_owned()
            }
            Self::Array(error) => error.help().to_owned(),
            Self::Unreadable(_) | Self::Table(TableError::Unreadable(_)) => {
                "check the name of the file, its permissions and its size".to_owned()
            }
            Self::Overlong { .. } => "the file is truncated or damaged; write it again".to_owned(),
            Self::Missing { .. } => format!(
                "needed: `patterns` {} of {}, and `displacement` {} in mm",
                rows_shape(&pattern_extents(raster)),
                numbers(device, "and"),
                rows_shape(&field_extents(raster))
            ),
            Self::Shape { expected, .. } => format!("allowed: {}", rows_shape(expected)),
            Self::Lengths { .. } => "give one field per pattern, in the same order".to_owned(),
            Self::Empty | Self::Rows(_) => format!("allowed: 1 to {MAX_ROWS} rows"),
            Self::Units(_) => "convert displacements to mm and set `units` to `mm`".to_owned(),
            Self::Estimate { .. } => "import only simulated or measured fields: models are trained on them".to_owned(),
            Self::Cell { .. } => format!("allowed: {}", allowed_cells(device.groups)),
            Self::NotFinite { .. } => {
                format!(
                    "each row needs a finite displacement at each of its {columns} × {rows} corners; omit other rows"
                )
            }
            Self::Frame { .. } => {
                "the membrane is clamped: displacements on its edges and frame must not exceed 1e-6 mm".to_owned()
            }
            Self::Far { .. } => "convert displacements to mm: divide µm by 1000, multiply m by 1000".to_owned(),
            Self::Table(TableError::Notation(_) | TableError::Twice(_)) => {
                "write the table again; see the page \"Coming from …\" of the documentation".to_owned()
            }
            Self::Table(TableError::Columns { .. }) => {
                format!("needed, in any order: {}", COLUMNS.join(", "))
            }
            Self::Table(TableError::Line { .. }) | Self::Line { .. } | Self::Corner { .. } => format!(
                "each sample needs one line for each of its {columns} × {rows} corners; `electrode` is {} for the cell \
                 to the upper right, and empty or 0 on the right and upper edges",
                numbers(device, "or")
            ),
        }
    }
}

/// Returns the allowed values of a cell.
fn numbers(device: &Device, and: &str) -> String {
    match device.groups {
        1 => format!("0 {and} 1"),
        groups => format!("0 to {groups}"),
    }
}

/// Returns the shape of an array whose rows have these extents.
fn rows_shape(extents: &[u64]) -> String {
    let row: Vec<String> = extents.iter().map(u64::to_string).collect();
    format!("(n, {})", row.join(", "))
}
