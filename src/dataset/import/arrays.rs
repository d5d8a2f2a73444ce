//! Reads files with both arrays: NumPy archives, HDF5 of other programs, and the files that `deaflow solve` writes.

use std::ops::Range;
use std::path::Path;

use super::error::ImportError;
use super::shape::{DISPLACEMENT, PATTERNS, count_rows};
use crate::is_overlong;
use deaflow_array::{Array, ArrayError, ArrayFile, Format};
use deaflow_base::open_regular;
use deaflow_field::OutcomeKind;
use deaflow_hdf::HdfFile;
use deaflow_pattern::{Raster, is_of_mask};

/// Number of patterns that are read to see whether they are masks.
const FEW: usize = 64;

/// A file with both arrays.
pub struct Arrays {
    patterns: Array,
    displacement: Array,
    len: usize,
    scene: Option<String>,
    /// The value of electrodes, if the patterns are masks.
    mask: Option<f64>,
}

impl Arrays {
    /// Opens a file and checks its shapes, sizes, units and outcomes.
    pub fn open(path: &Path, format: Format, raster: Raster) -> Result<Self, ImportError> {
        let bytes = open_regular(path).and_then(|file| file.metadata());
        let bytes = bytes.map_err(|e| ImportError::Unreadable(e.to_string()))?.len();
        let file = ArrayFile::open(path, format)?;
        let [patterns, displacement] = [PATTERNS, DISPLACEMENT].map(|name| find(&file, name));
        let (patterns, displacement) = (patterns?, displacement?);
        if file.hdf5().is_some() {
            for (name, found) in [(PATTERNS, &patterns), (DISPLACEMENT, &displacement)] {
                let rows = found.shape().first().copied().unwrap_or(0);
                if is_overlong(rows, raster, bytes) {
                    let claimed = found
                        .shape()
                        .iter()
                        .fold(1_u64, |product, &n| product.saturating_mul(n));
                    return Err(ImportError::Overlong { name, claimed, bytes });
                }
            }
        }
        // Checking the shapes first limits how much is unpacked.
        let len = count_rows(patterns.shape(), displacement.shape(), raster)?;
        patterns.check()?;
        displacement.check()?;
        let mut scene = None;
        if let Some(file) = file.hdf5() {
            check_units(file)?;
            check_outcomes(file, len)?;
            scene = file.attribute("scene").map_err(ArrayError::from)?;
        }
        let first = patterns.rows(0..len.min(FEW))?;
        Ok(Self {
            mask: first.into_iter().find(|value| is_of_mask(*value)),
            patterns,
            displacement,
            len,
            scene,
        })
    }

    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns the scene that the file names.
    pub fn scene(&self) -> Option<&str> {
        self.scene.as_deref()
    }

    /// Returns what the reader did that a user should know.
    pub fn notes(&self) -> Vec<String> {
        let masks = self
            .mask
            .map(|value| format!("values 0 and {value} of `{PATTERNS}` read as 0 and 1"));
        self.displacement.notes().into_iter().chain(masks).collect()
    }

    /// Reads a range of rows of both arrays.
    pub fn numbers(&self, rows: Range<usize>) -> Result<(Vec<f64>, Vec<f64>), ImportError> {
        let cells = self.patterns.rows(rows.clone())?;
        Ok((cells, self.displacement.rows(rows)?))
    }
}

fn find(file: &ArrayFile, name: &'static str) -> Result<Array, ImportError> {
    match file.find(name)? {
        Some(array) => Ok(array),
        None => Err(ImportError::Missing {
            name,
            there: file.names()?,
        }),
    }
}

fn check_units(file: &HdfFile) -> Result<(), ImportError> {
    match file.units(DISPLACEMENT).map_err(ArrayError::from)? {
        Some(units) if !["", "mm"].contains(&units.trim()) => Err(ImportError::Units(units)),
        _ => Ok(()),
    }
}

/// Returns an error for rows whose `outcome` is an estimate or a prediction: models must not be trained or
/// tested on them.
fn check_outcomes(file: &HdfFile, len: usize) -> Result<(), ImportError> {
    let found = file.find("outcome").map_err(ArrayError::from)?;
    if found.is_none_or(|found| found.shape != [len as u64] || found.element.is_number()) {
        return Ok(());
    }
    let outcomes = file.texts("outcome").map_err(ArrayError::from)?;
    let approximate = [OutcomeKind::Estimated, OutcomeKind::Predicted];
    let is_approximate = |outcome: &String| approximate.iter().any(|kind| kind.name() == outcome);
    match outcomes.iter().position(is_approximate) {
        None => Ok(()),
        Some(row) => Err(ImportError::Estimate {
            row,
            outcome: outcomes[row].clone(),
        }),
    }
}
