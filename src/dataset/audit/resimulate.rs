//! Random rows, simulated again as they were made and on a finer mesh.

use super::error::AuditError;
use super::facts::CheckedRow;
use super::labels::{Judge, LabelCheck, REFERENCE};
use deaflow_field::{Mesh, SimulatorKind};

/// A row that was simulated again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resimulated {
    /// Which.
    pub index: usize,
    /// Largest difference from the finer solution in mm; `None` where that has no stable solution, or the dataset's mesh is
    /// the finest.
    pub error: Option<f64>,
    /// The error that it may have, in mm; `None` where nothing is said of it.
    pub allowed: Option<f64>,
    /// Whether its mesh is the finest.
    pub is_finest: bool,
}

impl Resimulated {
    /// Whether its error is larger than is allowed.
    #[must_use]
    pub fn exceeds(&self) -> bool {
        matches!((self.error, self.allowed), (Some(error), Some(allowed)) if error > allowed)
    }

    /// Whether the finer mesh knows no stable solution.
    #[must_use]
    pub fn is_unstable(&self) -> bool {
        self.error.is_none() && !self.is_finest
    }
}

/// Simulates one usable row on a finer mesh; `allowed` is the error that it may have, in mm.
///
/// # Errors
/// When a simulator cannot be set up; why.
pub fn resimulate(
    judge: &Judge<'_>,
    (index, row): (usize, &CheckedRow),
    mesh: Option<Mesh>,
    allowed: Option<f64>,
) -> Result<Option<Resimulated>, AuditError> {
    let Some((pattern, stored)) = row.usable() else {
        return Ok(None);
    };
    let wanted = match mesh {
        Some(mesh) => mesh.finer().map(SimulatorKind::Newton),
        None => Some(SimulatorKind::Newton(REFERENCE)),
    };
    let mut result = Resimulated {
        index,
        error: None,
        allowed,
        is_finest: wanted.is_none(),
    };
    if let Some(wanted) = wanted {
        let finer = judge
            .simulators
            .simulator(wanted)?
            .simulate(std::slice::from_ref(pattern));
        let finer = finer.into_iter().next().and_then(|simulation| simulation.field);
        result.error = finer.map(|finer| stored.max_difference(&finer));
    }
    Ok(Some(result))
}

/// Whether a label is known to be wrong.
#[must_use]
pub fn is_wrong(label: LabelCheck) -> bool {
    matches!(
        label,
        LabelCheck::Wrong(..) | LabelCheck::NoSolution | LabelCheck::Stable
    )
}
