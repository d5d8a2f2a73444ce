//! Solutions for a few patterns: the electric field, and the distance to the loss of stability.

use rayon::prelude::*;

use super::trial::Trial;
use crate::critical::CriticalVoltage;
use crate::effects::{
    Examined, NEAR, Stability, breakdown_ratio, breakdown_ratio_at_rest, breakdown_strength_or_usual,
};
use crate::{CriticalSearch, MembraneSolver, SetupError, SolveOptions, WorkLimit, cell_states};
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;
use deaflow_scene::{Breakdown, Effects, Scene};

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

/// What a screening is for: it says how far the loss of stability is searched for, and how well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A table for people.
    Table,
    /// The effects of a scene that leaves them open: on two meshes where one leaves the verdict open.
    Decision,
    /// The warnings of a run, likewise.
    Watch,
}

impl Purpose {
    /// Stability is searched for up to the voltage of the scene over the root of this share of κ: what is further away does not matter,
    /// and stiffening laws make it dear to find. A loss that a coarse mesh has beyond the reach of a decision is
    /// beyond [`NEAR`] on every mesh.
    #[must_use]
    pub fn reach(self) -> f64 {
        match self {
            Self::Table => 0.1,
            Self::Decision | Self::Watch => 0.75 * NEAR,
        }
    }
}

/// Examines the solutions for patterns, and searches for the loss of stability within reach. `limit` is the work for a pattern.
///
/// Where patterns are lost without a fringe field is known in a ninth of the time, and near enough to tell which of them go first: only
/// these are searched with it.
///
/// # Errors
/// When the scene cannot be simulated.
pub fn examine(
    scene: &Scene,
    patterns: &[Trial],
    purpose: Purpose,
    limit: WorkLimit,
) -> Result<Vec<Examined>, SetupError> {
    let breakdown = breakdown_strength_or_usual(scene);
    let solver = MembraneSolver::new(scene, MESH)?.within(limit.part(SOLVING));
    let far = scene.at_voltage(scene.voltage_v() / purpose.reach().sqrt());
    let without_fringe = Effects {
        fringe_field: None,
        ..scene.effects.clone()
    };
    let searching = limit.part(SEARCHING);
    let search = CriticalSearch::new(&far.with_effects(without_fringe), MESH)?.within(searching);
    let mut examined: Vec<Examined> = patterns
        .par_iter()
        .map(|trial| examine_one(scene, &solver, &search, trial, &breakdown))
        .collect::<Result<_, _>>()?;
    let enough = |limit: &CriticalVoltage| match purpose {
        Purpose::Table => false,
        Purpose::Decision | Purpose::Watch => is_decided(scene, limit),
    };
    if scene.effects.fringe_field.is_some() {
        let search = CriticalSearch::new(&far, MESH)?.within(searching);
        let refined = |pattern: &Pattern, coarse: CriticalVoltage| match enough(&coarse) {
            true => coarse,
            false => search.refine(pattern, coarse.voltage),
        };
        look_again_at_the_first(patterns, &mut examined, |pattern, limit| {
            let coarse = search.near_on_coarse(pattern, limit.voltage)?;
            Some(refined(pattern, coarse))
        });
    } else {
        look_again_at_the_first(patterns, &mut examined, |pattern, limit| {
            (!enough(&limit)).then(|| search.refine(pattern, limit.voltage))
        });
    }
    Ok(examined)
}

/// Whether the verdict on stability is the same at both ends of the interval of a limit.
fn is_decided(scene: &Scene, limit: &CriticalVoltage) -> bool {
    let [most, least] = limit.interval().map(|voltage| (scene.voltage_v() / voltage).powi(2));
    most < NEAR || least > NEAR
}

/// Searches again for the limits of those patterns that could be the first to lose stability; what is not found is as before.
fn look_again_at_the_first(
    patterns: &[Trial],
    examined: &mut [Examined],
    near: impl Fn(&Pattern, CriticalVoltage) -> Option<CriticalVoltage> + Sync,
) {
    let lost = |one: &Examined| match one.stability {
        Some(Stability::Lost(limit)) => Some(limit),
        _ => None,
    };
    let limits = examined.iter().filter_map(lost);
    let lowest = limits.map(|limit| limit.voltage).fold(f64::INFINITY, f64::min);
    examined.par_iter_mut().zip(patterns).for_each(|(one, trial)| {
        let candidate = lost(one).filter(|limit| limit.interval()[0] <= lowest);
        if let Some(found) = candidate.and_then(|limit| near(&trial.pattern, limit)) {
            one.stability = Some(Stability::Lost(found));
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
    let stable = solution.outcome.is_converged();
    let active = pattern.active_cells() > 0;
    Ok(Examined {
        pattern: trial.name.clone(),
        field: if stable {
            let states = cell_states(scene, solver.mesh(), pattern, &solution.displacement)?;
            breakdown_ratio(breakdown, scene.thickness_mm(), &states)
        } else if active {
            breakdown_ratio_at_rest(breakdown, scene)
        } else {
            0.0
        },
        stability: match trial.to_the_limit {
            true => Some(search.look(pattern)),
            false if stable => None,
            false => Some(solution.stability(solver.mesh())),
        },
        outcome: solution.outcome,
    })
}
