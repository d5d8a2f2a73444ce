//! Finds out on which mesh fields were solved, where the dataset does not say: on that mesh they come out the same.

use super::error::AuditError;
use super::facts::CheckedRow;
use super::labels::Tolerance;
use deaflow_field::{Mesh, SimulatorKind, Simulators};

/// The meshes that are tried, cheapest first.
pub const TRIED: [Mesh; 12] = [
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

/// Part of the largest displacement within which fields are the same. Meshes differ by far more.
const SAME: f64 = 1e-5;

/// Displacements below this, mm, tell nothing of a mesh.
const MOVING: f64 = 1e-4;

/// How well rows come out on a mesh: the rows that are the same, those within the tolerance, and what all are off by.
struct Trial {
    mesh: Mesh,
    same: usize,
    near: usize,
    off: f64,
}

/// The mesh on which most of these rows come out the same. One is enough: that does not happen by chance. Of rounded fields
/// none does, and more than half have to come out within the tolerance. `None` where there is no such mesh among those tried.
///
/// # Errors
/// When a simulator cannot be set up; why.
pub fn mesh(
    simulators: &dyn Simulators,
    rows: &[CheckedRow],
    tolerance: Tolerance,
) -> Result<Option<Mesh>, AuditError> {
    // A field of zeros is the same on every mesh.
    let moving = |(_, field): &(_, &deaflow_field::Field)| field.max_magnitude() > MOVING;
    let rows: Vec<_> = rows.iter().filter_map(CheckedRow::usable).filter(moving).collect();
    let patterns: Vec<_> = rows.iter().map(|(pattern, _)| (*pattern).clone()).collect();
    let mut best: Option<Trial> = None;
    for mesh in TRIED {
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
