//! Solutions for a few patterns: compression, field, and the distance to the loss of stability.

use rayon::prelude::*;

use super::Trial;
use crate::fem::effects::{Examined, NEAR, breakdown_ratio, breakdown_ratio_at_rest, breakdown_strength_or_usual};
use crate::fem::{CriticalSearch, MembraneSolver, SetupError, SolveOptions, Survey, cell_states};
use crate::field::Mesh;
use crate::scene::{Breakdown, Scene};

/// A mesh on which the loss of stability comes out a few per cent high; bilinear elements of the same size would place that
/// of a single cell 12 % too high.
const MESH: SolveOptions = SolveOptions {
    mesh: Mesh::biquadratic(1),
    tolerance: 1e-8,
};

/// Examines the solutions for patterns, and searches for the loss of stability up to the voltage of the scene over the root of `reach`;
/// on two meshes where it is searched for far from that voltage, which is for a table, and on one for a run.
///
/// # Errors
/// When the scene cannot be simulated.
pub fn examine(scene: &Scene, patterns: &[Trial], reach: f64) -> Result<Vec<Examined>, SetupError> {
    let breakdown = breakdown_strength_or_usual(scene);
    let solver = MembraneSolver::new(scene, MESH)?;
    let search = CriticalSearch::new(&scene.at_voltage(scene.voltage_v() / reach.sqrt()), MESH)?;
    patterns
        .par_iter()
        .map(|trial| examine_one(scene, &solver, (&search, reach), trial, &breakdown))
        .collect()
}

fn examine_one(
    scene: &Scene,
    solver: &MembraneSolver,
    (search, reach): (&CriticalSearch, f64),
    trial: &Trial,
    breakdown: &Breakdown,
) -> Result<Examined, SetupError> {
    let pattern = &trial.pattern;
    let solution = solver.solve(pattern);
    let reached = solution.outcome.bracket().map(|[stable, _]| scene.at_voltage(stable));
    let states = cell_states(
        reached.as_ref().unwrap_or(scene),
        solver.mesh(),
        pattern,
        &solution.displacement,
    )?;
    let stable = solution.outcome.is_converged();
    let active = pattern.cells().contains(&1);
    Ok(Examined {
        pattern: trial.name.clone(),
        compression: -Survey::of(&states, scene.shear_modulus_pa()).smallest_stress,
        field: match stable {
            true => breakdown_ratio(breakdown, scene.thickness_mm(), &states),
            false if active => breakdown_ratio_at_rest(breakdown, scene),
            false => 0.0,
        },
        limit: match trial.to_the_limit {
            true if reach < NEAR => search.below_scene(pattern),
            true => search.unrefined(pattern),
            false => None,
        },
        stable,
    })
}
