//! Histories to a requested accuracy, by the sequence of meshes of [`AccurateSolver`].

use super::history::{History, HistoryRequest};
use crate::accurate::{AccurateSolver, MESHES};
use crate::error::SetupError;
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;

/// A history on the chosen mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct AccurateHistory {
    /// The history.
    pub history: History,
    /// Its mesh.
    pub mesh: Mesh,
    /// Estimate of the largest displacement error in mm due to the mesh, over the requested times; `None` if a mesh
    /// finds no stable state at the last of them.
    pub space_error_mm: Option<f64>,
}

impl AccurateSolver {
    /// Simulates the history of a pattern on a mesh that is fine enough.
    ///
    /// # Errors
    /// When the preconditioner of a finer mesh cannot be set up.
    pub fn history(&self, pattern: &Pattern, request: &HistoryRequest) -> Result<AccurateHistory, SetupError> {
        let mut coarse = self.on_level(0)?.history(pattern, request)?;
        let mut level = 0;
        loop {
            let fine = self.on_level(level + 1)?.history(pattern, request)?;
            let complete = coarse.outcome.is_converged() && fine.outcome.is_converged();
            let error = complete.then(|| MESHES[level].1 * coarse.difference(&fine));
            let last = level + 2 == MESHES.len();
            if last || error.is_some_and(|error| error <= self.accuracy_mm()) {
                return Ok(AccurateHistory {
                    history: coarse,
                    mesh: MESHES[level].0,
                    space_error_mm: error,
                });
            }
            coarse = fine;
            level += 1;
        }
    }
}
