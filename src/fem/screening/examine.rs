//! Examines solutions for a few patterns: electric field and critical voltage.

use rayon::prelude::*;

use super::test_pattern::TestPattern;
use crate::critical::CriticalVoltage;
use crate::effects::{
    Examined, NEAR, StableRange, breakdown_ratio, breakdown_ratio_at_rest, breakdown_strength_or_default,
};
use crate::{CriticalSearch, MembraneSolver, MeshSolution, SetupError, SolveOptions, WorkLimit};
use deaflow_field::{Mesh, Simulation};
use deaflow_pattern::Pattern;
use deaflow_scene::{Breakdown, Effects, Scene};

/// A mesh whose critical voltages are a few per cent too high; with bilinear elements of the same size that of a single
/// cell would be 12 % too high.
const MESH: SolveOptions = SolveOptions {
    mesh: Mesh::biquadratic(1),
    tolerance: 1e-8,
};

/// Shares of the work for a pattern that its solution and a search on one mesh may take; a finer mesh has four times as
/// many unknowns and is searched in two load paths.
const SOLVING: f64 = 0.5;
const SEARCHING: f64 = 0.4;

/// The purpose of a screening, which sets range and accuracy of the search for critical voltages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The table of `deaflow screen`.
    Table,
    /// Choosing the effects with `effects: auto`; a second mesh is used if one leaves the verdict open.
    Decision,
    /// The warnings about given patterns, whose stability is known from their results.
    Warnings,
}

impl Purpose {
    /// Returns the smallest κ/κ(critical) that is searched for: further losses do not matter, and stiffening laws make
    /// them expensive to find. A critical voltage beyond this range on a coarse mesh is beyond [`NEAR`] on every mesh.
    fn smallest_ratio(self) -> f64 {
        match self {
            Self::Table => 0.1,
            Self::Decision | Self::Warnings => 0.75 * NEAR,
        }
    }
}

/// Returns the largest E/E_B over the cells in a solution; without a stable one that of the membrane at rest.
pub fn field_ratio(breakdown: &Breakdown, solver: &MembraneSolver, pattern: &Pattern, solution: &MeshSolution) -> f64 {
    let scene = &solver.scene;
    if solution.outcome.is_converged() {
        let states = solver.cell_states(pattern, solution);
        breakdown_ratio(breakdown, scene.thickness_mm(), &states)
    } else if pattern.active_cells() > 0 {
        breakdown_ratio_at_rest(breakdown, scene)
    } else {
        0.0
    }
}

/// Returns a scene whose results also tell the field that [`examined`] needs. Their displacements are the same.
#[must_use]
pub fn observing_breakdown(scene: &Scene) -> Scene {
    scene.with_effects(Effects {
        dielectric_breakdown: Some(breakdown_strength_or_default(scene)),
        ..scene.effects.clone()
    })
}

/// Returns what the solution for a pattern in an [observed](observing_breakdown) scene tells.
#[must_use]
pub fn examined(name: &str, scene: &Scene, pattern: &Pattern, simulation: &Simulation) -> Examined {
    let at_rest = || match pattern.active_cells() {
        0 => 0.0,
        _ => breakdown_ratio_at_rest(&breakdown_strength_or_default(scene), scene),
    };
    Examined {
        pattern: name.to_owned(),
        outcome: simulation.outcome,
        field: simulation.observation.breakdown_ratio.unwrap_or_else(at_rest),
        stability: None,
    }
}

/// Examines the solutions for patterns, and searches for critical voltages within range. `limit` is the work for each
/// pattern.
///
/// Without a fringe field a critical voltage takes a ninth of the time and is accurate enough to find the lowest ones:
/// only these are searched with the field.
///
/// # Errors
/// If the scene cannot be simulated.
pub fn examine(
    scene: &Scene,
    patterns: &[TestPattern],
    purpose: Purpose,
    limit: WorkLimit,
) -> Result<Vec<Examined>, SetupError> {
    let breakdown = breakdown_strength_or_default(scene);
    let solver = MembraneSolver::new(scene, MESH)?.within(limit.part(SOLVING));
    let far = scene.at_voltage(scene.voltage_v() / purpose.smallest_ratio().sqrt());
    let without_fringe = Effects {
        fringe_field: None,
        ..scene.effects.clone()
    };
    let searching = limit.part(SEARCHING);
    let search = CriticalSearch::new(&far.with_effects(without_fringe), MESH)?.within(searching);
    let mut examined: Vec<Examined> = patterns
        .par_iter()
        .map(|pattern| examine_one(&solver, &search, pattern, &breakdown))
        .collect();
    let enough = |limit: &CriticalVoltage| match purpose {
        Purpose::Table => false,
        Purpose::Decision | Purpose::Warnings => is_decided(scene, limit),
    };
    if scene.effects.fringe_field.is_some() {
        let search = CriticalSearch::new(&far, MESH)?.within(searching);
        let refined = |pattern: &Pattern, coarse: CriticalVoltage| match enough(&coarse) {
            true => coarse,
            false => search.refine(pattern, coarse.voltage),
        };
        refine_lowest(patterns, &mut examined, |test, limit| {
            let coarse = search.near_on_coarse(&test.pattern, limit.voltage)?;
            Some(with_geometry(&search, test, refined(&test.pattern, coarse)))
        });
    } else {
        refine_lowest(patterns, &mut examined, |test, limit| {
            (!enough(&limit)).then(|| with_geometry(&search, test, search.refine(&test.pattern, limit.voltage)))
        });
    }
    Ok(examined)
}

/// Adds the error of the cells of a drawn pattern, if elements can follow its shapes. Where they cannot, the reader of
/// the drawing has told how well the cells agree with it.
fn with_geometry(search: &CriticalSearch, test: &TestPattern, found: CriticalVoltage) -> CriticalVoltage {
    let drawn = test.drawing.as_ref();
    let drawn = drawn.map(|drawing| search.with_geometry([&test.pattern, drawing], found));
    drawn.filter(|drawn| drawn.error.is_some()).unwrap_or(found)
}

/// Returns whether the verdict on stability is the same at both ends of the interval of a critical voltage.
fn is_decided(scene: &Scene, limit: &CriticalVoltage) -> bool {
    let [most, least] = limit.interval().map(|voltage| (scene.voltage_v() / voltage).powi(2));
    most < NEAR || least > NEAR
}

/// Searches again for the critical voltages that could be the lowest; those not found stay as they are.
fn refine_lowest(
    patterns: &[TestPattern],
    examined: &mut [Examined],
    near: impl Fn(&TestPattern, CriticalVoltage) -> Option<CriticalVoltage> + Sync,
) {
    let lost = |one: &Examined| match one.stability {
        Some(StableRange::Lost(limit)) => Some(limit),
        _ => None,
    };
    let limits = examined.iter().filter_map(lost);
    let lowest = limits.map(|limit| limit.voltage).fold(f64::INFINITY, f64::min);
    examined.par_iter_mut().zip(patterns).for_each(|(one, test)| {
        let candidate = lost(one).filter(|limit| limit.interval()[0] <= lowest);
        if let Some(found) = candidate.and_then(|limit| near(test, limit)) {
            one.stability = Some(StableRange::Lost(found));
        }
    });
}

fn examine_one(
    solver: &MembraneSolver,
    search: &CriticalSearch,
    test: &TestPattern,
    breakdown: &Breakdown,
) -> Examined {
    let pattern = &test.pattern;
    let solution = solver.solve(pattern);
    Examined {
        pattern: test.name.clone(),
        field: field_ratio(breakdown, solver, pattern, &solution),
        stability: match test.find_critical_voltage {
            true => Some(search.stable_range(pattern)),
            false if solution.outcome.is_converged() => None,
            false => Some(solution.stable_range(solver.mesh())),
        },
        outcome: solution.outcome,
    }
}
