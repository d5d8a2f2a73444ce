//! Reader of HDF5 files: those of other programs, and those that `deaflow solve` writes.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::error::ImportError;
use super::shape::{DISPLACEMENT, PATTERNS, count_rows};
use crate::is_overlong;
use deaflow_base::open_regular;
use deaflow_field::OutcomeKind;
use deaflow_hdf::{DatasetInfo, HdfError, HdfFile};
use deaflow_pattern::Raster;

/// An HDF5 file with both arrays at its root.
pub struct Hdf {
    path: PathBuf,
    len: usize,
    scene: Option<String>,
}

impl Hdf {
    /// Opens a file and checks its shapes, units and outcomes. The file is read in another process.
    pub fn open(path: &Path, raster: Raster) -> Result<Self, ImportError> {
        let bytes = open_regular(path).and_then(|file| file.metadata());
        let bytes = bytes.map_err(|e| ImportError::Unreadable(e.to_string()))?.len();
        let file = HdfFile::open_untrusted(path).map_err(unreadable)?;
        let [patterns, displacement] = [PATTERNS, DISPLACEMENT].map(|name| array(&file, name));
        let (patterns, displacement) = (patterns?, displacement?);
        for (name, found) in [(PATTERNS, &patterns), (DISPLACEMENT, &displacement)] {
            let rows = found.shape.first().copied().unwrap_or(0);
            if is_overlong(rows, raster, bytes) {
                let claimed = found.shape.iter().fold(1_u64, |product, &n| product.saturating_mul(n));
                return Err(ImportError::Overlong { name, claimed, bytes });
            }
        }
        let len = count_rows(&patterns.shape, &displacement.shape, raster)?;
        match file.units(DISPLACEMENT).map_err(unreadable)? {
            Some(units) if !["", "mm"].contains(&units.trim()) => return Err(ImportError::Units(units)),
            _ => {}
        }
        check_outcomes(&file, len)?;
        Ok(Self {
            path: path.to_owned(),
            len,
            scene: file.attribute("scene").map_err(unreadable)?,
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

    /// Reads a range of rows of both arrays.
    pub fn numbers(&self, rows: Range<usize>) -> Result<(Vec<f64>, Vec<f64>), ImportError> {
        let file = HdfFile::open_untrusted(&self.path).map_err(unreadable)?;
        let cells = file.numbers(PATTERNS, rows.clone()).map_err(unreadable)?;
        Ok((cells, file.numbers(DISPLACEMENT, rows).map_err(unreadable)?))
    }
}

fn array(file: &HdfFile, name: &'static str) -> Result<DatasetInfo, ImportError> {
    let Some(found) = file.find(name).map_err(unreadable)? else {
        let there = file.names().map_err(unreadable)?;
        return Err(ImportError::Missing { name, there });
    };
    match found.element.is_number() {
        true => Ok(found),
        false => Err(ImportError::Elements {
            name,
            why: "elements are not numbers".to_owned(),
        }),
    }
}

/// Returns an error for rows whose `outcome` is an estimate or a prediction: models must not be trained or
/// tested on them.
fn check_outcomes(file: &HdfFile, len: usize) -> Result<(), ImportError> {
    let found = file.find("outcome").map_err(unreadable)?;
    if found.is_none_or(|found| found.shape != [len as u64] || found.element.is_number()) {
        return Ok(());
    }
    let outcomes = file.texts("outcome").map_err(unreadable)?;
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

fn unreadable(error: HdfError) -> ImportError {
    ImportError::Unreadable(error.reason())
}
