//! Simulates random rows on a finer mesh.

use super::error::AuditError;
use super::facts::CheckedRow;
use super::labels::{LabelCheck, LabelChecker, REFERENCE};
use deaflow_field::{Mesh, SimulatorKind};

/// A row that was simulated on a finer mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resimulated {
    /// Index of the row.
    pub index: usize,
    /// Largest difference from the finer solution in mm; `None` if there is no stable solution, or no finer mesh.
    pub error: Option<f64>,
    /// Largest allowed error in mm, if there is one.
    pub allowed: Option<f64>,
    /// Whether there is no finer mesh.
    pub is_finest: bool,
}

impl Resimulated {
    /// Returns whether the error is larger than allowed.
    #[must_use]
    pub fn exceeds(&self) -> bool {
        matches!((self.error, self.allowed), (Some(error), Some(allowed)) if error > allowed)
    }

    /// Returns whether there is no stable solution on the finer mesh.
    #[must_use]
    pub fn is_unstable(&self) -> bool {
        self.error.is_none() && !self.is_finest
    }
}

/// Simulates a row on a finer mesh; `allowed` is the largest allowed error in mm. Returns `None` for a row without
/// pattern or field.
///
/// # Errors
/// When a simulator cannot be set up.
pub fn resimulate(
    checker: &LabelChecker<'_>,
    (index, row): (usize, &CheckedRow),
    mesh: Option<Mesh>,
    allowed: Option<f64>,
) -> Result<Option<Resimulated>, AuditError> {
    let Some((pattern, stored)) = row.usable() else {
        return Ok(None);
    };
    let finer = mesh.map_or(Some(REFERENCE), Mesh::finer);
    let solution = match finer {
        Some(mesh) => checker.solve(SimulatorKind::Newton(mesh), pattern)?,
        None => None,
    };
    Ok(Some(Resimulated {
        index,
        error: solution.map(|solution| stored.max_difference(&solution)),
        allowed,
        is_finest: finer.is_none(),
    }))
}

/// Returns whether a label is known to be wrong.
#[must_use]
pub fn is_wrong(label: LabelCheck) -> bool {
    matches!(
        label,
        LabelCheck::Wrong(..) | LabelCheck::NoSolution | LabelCheck::Stable
    )
}
