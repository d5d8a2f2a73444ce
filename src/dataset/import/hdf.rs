//! HDF5 files of others, and those that `deaflow solve` writes.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::error::ImportError;
use super::{DISPLACEMENT, PATTERNS, count};
use crate::is_overlong;
use deaflow_base::open_regular;
use deaflow_field::Outcome;
use deaflow_hdf::{Found, HdfError, HdfFile};
use deaflow_pattern::Raster;

/// The word for a field that a network has predicted.
const PREDICTED: &str = "predicted";

/// A file with both arrays at its root.
pub struct Hdf {
    path: PathBuf,
    len: usize,
    scene: Option<String>,
}

impl Hdf {
    /// Looks at a file, in another process.
    pub fn open(path: &Path, raster: Raster) -> Result<Self, ImportError> {
        let bytes = open_regular(path).and_then(|file| file.metadata());
        let bytes = bytes.map_err(|e| ImportError::Unreadable(e.to_string()))?.len();
        let file = HdfFile::apart(path).map_err(refused)?;
        let [patterns, displacement] = [PATTERNS, DISPLACEMENT].map(|name| array(&file, name));
        let (patterns, displacement) = (patterns?, displacement?);
        for (name, found) in [(PATTERNS, &patterns), (DISPLACEMENT, &displacement)] {
            let rows = found.shape.first().copied().unwrap_or(0);
            if is_overlong(rows, raster, bytes) {
                let claimed = found.shape.iter().fold(1_u64, |product, &n| product.saturating_mul(n));
                return Err(ImportError::Overlong { name, claimed, bytes });
            }
        }
        let len = count(&patterns.shape, &displacement.shape, raster)?;
        match file.units(DISPLACEMENT).map_err(refused)? {
            Some(units) if !["", "mm"].contains(&units.trim()) => return Err(ImportError::Units(units)),
            _ => {}
        }
        check_outcomes(&file, len)?;
        Ok(Self {
            path: path.to_owned(),
            len,
            scene: file.attribute("scene").map_err(refused)?,
        })
    }

    /// How many rows it has.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The scene that it names.
    pub fn scene(&self) -> Option<&str> {
        self.scene.as_deref()
    }

    /// The numbers of some rows, of both arrays.
    pub fn numbers(&self, rows: Range<usize>) -> Result<(Vec<f64>, Vec<f64>), ImportError> {
        let file = HdfFile::apart(&self.path).map_err(refused)?;
        let cells = file.numbers(PATTERNS, rows.clone()).map_err(refused)?;
        Ok((cells, file.numbers(DISPLACEMENT, rows).map_err(refused)?))
    }
}

fn array(file: &HdfFile, name: &'static str) -> Result<Found, ImportError> {
    let Some(found) = file.find(name).map_err(refused)? else {
        let there = file.names().map_err(refused)?;
        return Err(ImportError::Missing { name, there });
    };
    match found.element.is_number() {
        true => Ok(found),
        false => Err(ImportError::Elements {
            name,
            why: "its elements are no numbers".to_owned(),
        }),
    }
}

/// Refuses estimates and predictions, as the files of this program call them: nobody is to learn from them or be judged by them.
fn check_outcomes(file: &HdfFile, len: usize) -> Result<(), ImportError> {
    let found = file.find("outcome").map_err(refused)?;
    if found.is_none_or(|found| found.shape != [len as u64] || found.element.is_number()) {
        return Ok(());
    }
    let outcomes = file.texts("outcome").map_err(refused)?;
    let guessed = |outcome: &String| [Outcome::Estimated.name(), PREDICTED].contains(&outcome.as_str());
    match outcomes.iter().position(guessed) {
        None => Ok(()),
        Some(row) => Err(ImportError::Estimate {
            row,
            outcome: outcomes[row].clone(),
        }),
    }
}

fn refused(error: HdfError) -> ImportError {
    ImportError::Unreadable(error.reason())
}
