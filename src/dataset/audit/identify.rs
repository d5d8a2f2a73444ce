//! Identifies the mesh of the fields if the dataset does not declare it: simulations on that mesh give the same fields.

use super::error::AuditError;
use super::facts::CheckedRow;
use super::labels::Tolerance;
use deaflow_field::{Mesh, SimulatorKind, Simulators};

/// Candidate meshes, cheapest first.
pub const CANDIDATES: [Mesh; 12] = [
    Mesh::bilinear(1),
    Mesh::bilinear(2),
    Mesh::biquadratic(1),
    Mesh::bilinear(3),
    Mesh::bilinear(4),
    Mesh::biquadratic(2),
    Mesh::bilinear(5),
    Mesh::bilinear(6),
    Mesh::biquadratic(3),
    Mesh::bilinear(8),
    Mesh::biquadratic(4),
    Mesh::biquadratic(8),
];

/// Largest difference, relative to the largest displacement, of equal fields. Fields on different meshes differ by far
/// more.
const SAME: f64 = 1e-5;

/// Smallest displacement in mm of a field that can identify a mesh.
const MOVING: f64 = 1e-4;

/// Agreement of rows with simulations on a mesh.
struct Trial {
    mesh: Mesh,
    /// Rows with equal fields.
    same: usize,
    /// Rows within the tolerance.
    near: usize,
    /// Sum of the differences in mm.
    off: f64,
}

/// Returns the candidate mesh on which most rows have the same field. One such row is enough, because equality does
/// not occur by chance. Rounded fields are not equal; then more than half of the rows must be within the tolerance.
///
/// # Errors
/// When a simulator cannot be set up.
pub fn mesh(
    simulators: &dyn Simulators,
    rows: &[CheckedRow],
    tolerance: Tolerance,
) -> Result<Option<Mesh>, AuditError> {
    // A zero field is the same on every mesh.
    let moving = |(_, field): &(_, &deaflow_field::Field)| field.max_magnitude() > MOVING;
    let rows: Vec<_> = rows.iter().filter_map(CheckedRow::usable).filter(moving).collect();
    let patterns: Vec<_> = rows.iter().map(|(pattern, _)| (*pattern).clone()).collect();
    let mut best: Option<Trial> = None;
    for mesh in CANDIDATES {
        let found = simulators.simulator(SimulatorKind::Newton(mesh))?.simulate(&patterns);
        let mut trial = Trial {
            mesh,
            same: 0,
            near: 0,
            off: 0.0,
        };
        for ((_, stored), found) in rows.iter().zip(&found) {
            let Some(found) = &found.field else { continue };
            let (off, peak) = (stored.max_difference(found), found.max_magnitude());
            trial.same += usize::from(off <= SAME * peak);
            trial.near += usize::from(off <= tolerance.of(peak));
            trial.off += off.min(peak);
        }
        if 2 * trial.same > rows.len() {
            return Ok(Some(mesh));
        }
        let is_better = |best: &Trial| {
            let order = (trial.same, trial.near).cmp(&(best.same, best.near));
            order.then(best.off.total_cmp(&trial.off)).is_gt()
        };
        if best.as_ref().is_none_or(is_better) {
            best = Some(trial);
        }
    }
    let known = best.filter(|best| best.same > 0 || 2 * best.near > rows.len());
    Ok(known.map(|best| best.mesh))
}
