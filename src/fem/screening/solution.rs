//! Solutions for a few patterns: compression, field, and the distance to the loss of stability.

use rayon::prelude::*;

use super::trial::Trial;
use crate::fem::effects::{Examined, NEAR, breakdown_ratio, breakdown_ratio_at_rest, breakdown_strength_or_usual};
use crate::fem::{CriticalSearch, MembraneSolver, SetupError, SolveOptions, Survey, WorkLimit, cell_states};
use crate::field::{Mesh, Outcome};
use crate::scene::{Breakdown, Scene};

/// A mesh on which the loss of stability comes out a few per cent high; bilinear elements of the same size would place that
/// of a single cell 12 % too high.
const MESH: SolveOptions = SolveOptions {
    mesh: Mesh::biquadratic(1),
    tolerance: 1e-8,
};

/// The parts of the work for a pattern that its solution and a search on one mesh may take; a finer mesh has four times as many unknowns and
/// is searched in two climbs.
const SOLVING: f64 = 0.5;
const SEARCHING: f64 = 0.4;

/// Examines the solutions for patterns, and searches for the loss of stability up to the voltage of the scene over the root of `reach`;
/// on two meshes where it is searched for far from that voltage, which is for a table, and on one for a run. `limit` is the work for a
/// pattern.
///
/// # Errors
/// When the scene cannot be simulated.
pub fn examine(scene: &Scene, patterns: &[Trial], reach: f64, limit: WorkLimit) -> Result<Vec<Examined>, SetupError> {
    let breakdown = breakdown_strength_or_usual(scene);
    let solver = MembraneSolver::new(scene, MESH)?.within(limit.part(SOLVING));
    let search = CriticalSearch::new(&scene.at_voltage(scene.voltage_v() / reach.sqrt()), MESH)?;
    let search = search.within(limit.part(SEARCHING));
    let mut examined: Vec<Examined> = patterns
        .par_iter()
        .map(|trial| examine_one(scene, &solver, &search, trial, &breakdown))
        .collect::<Result<_, _>>()?;
    if reach < NEAR {
        refine_the_first(&search, patterns, &mut examined);
    }
    Ok(examined)
}

/// Refines the limits of those patterns that could be the first to lose stability.
fn refine_the_first(search: &CriticalSearch, patterns: &[Trial], examined: &mut [Examined]) {
    let limits = examined.iter().filter_map(|one| one.limit);
    let lowest = limits.map(|limit| limit.voltage).fold(f64::INFINITY, f64::min);
    examined.par_iter_mut().zip(patterns).for_each(|(one, trial)| {
        let candidate = one.limit.filter(|limit| limit.interval()[0] <= lowest);
        if let Some(limit) = candidate {
            one.limit = Some(search.refine(&trial.pattern, limit.voltage));
        }
    });
}

fn examine_one(
    scene: &Scene,
    solver: &MembraneSolver,
    search: &CriticalSearch,
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
    let searched = trial.to_the_limit.then(|| search.outcome(pattern));
    Ok(Examined {
        pattern: trial.name.clone(),
        compression: -Survey::of(&states, scene.shear_modulus_pa()).smallest_stress,
        field: match stable {
            true => breakdown_ratio(breakdown, scene.thickness_mm(), &states),
            false if active => breakdown_ratio_at_rest(breakdown, scene),
            false => 0.0,
        },
        limit: searched.and_then(|outcome| search.of_outcome(outcome)),
        stable,
        given_up: [Some(solution.outcome), searched].contains(&Some(Outcome::WorkLimit)),
    })
}
