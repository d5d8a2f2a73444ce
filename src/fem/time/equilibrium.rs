//! The equilibrium at the end of a step, with branches whose stress may depend on the end state in any way.

use super::viscous::Viscous;
use crate::charge::{self, ChargedState};
use crate::continuation::{Loading, Problem};
use crate::material::Material;
use crate::newton::{self, NewtonFailure, Progress, Workspace};
use crate::operator::{Activity, Operator};
use deaflow_scene::Scene;

/// Largest number of corrections of the stress of the branches. About five are enough; a step that needs too many is
/// too long.
const CORRECTIONS: usize = 40;
/// Reduction of the residual between two corrections: about a Newton step.
const FALL: f64 = 0.3;
/// A displacement in units of length that counts as rounding.
const STILL: f64 = 1e-12;

/// Moves `u` to the nearby equilibrium at the end of a step of some seconds; returns the membrane with the stress of
/// its branches there.
///
/// # Errors
/// As [`newton::solve`].
pub fn equilibrium<L: Material, F>(
    problem: &Problem<'_, F>,
    material: &L,
    viscous: &mut Viscous,
    step: f64,
    u: &mut [f64],
    workspace: &mut Workspace,
) -> Result<(Activity, Progress), (NewtonFailure, Progress)> {
    let depends = viscous.depends_on_end(step);
    // The residual at the guess measures the distance to the equilibrium.
    let mut tolerance = if depends { 1.0 } else { problem.tolerance };
    let mut activity = viscous.remembered_at(problem.activity, step, u);
    let mut all = Progress {
        steps: 0,
        residual: 0.0,
    };
    for _ in 0..CORRECTIONS {
        let operator = Operator::new(material, &activity);
        let before = u.to_vec();
        let found = newton::solve(&operator, problem.laplacian, tolerance, u, workspace);
        let (Ok(progress) | Err((_, progress))) = found;
        all.steps += progress.steps;
        all.residual = progress.residual;
        if let Err((trouble, _)) = found {
            return Err((trouble, all));
        }
        // A residual above the tolerance may be rounding, too.
        let is_enough = tolerance <= problem.tolerance || progress.residual > tolerance;
        let is_still = u.iter().zip(&before).all(|(u, before)| (u - before).abs() <= STILL);
        if !depends || (is_still && (is_enough || progress.steps > 0)) {
            return Ok((activity, all));
        }
        if progress.steps > 0 {
            viscous.recycle(activity);
            activity = viscous.remembered_at(problem.activity, step, u);
        }
        tolerance = (FALL * progress.residual).max(problem.tolerance);
    }
    Err((NewtonFailure::Limit, all))
}

/// Returns the equilibrium at the end of a step of some seconds with a charge on conducting electrodes, from a nearby
/// state.
///
/// # Errors
/// As [`charge::near`], and when the corrections for the branches do not converge.
pub fn at_charge<L: Material, F: Fn(f64) -> L>(
    problem: &Problem<'_, F>,
    (scene, charge): (&Scene, f64),
    (viscous, step): (&mut Viscous, f64),
    start: &[f64],
    (workspace, total): (&mut Workspace, &mut Loading),
) -> Result<ChargedState, charge::ChargeFailure> {
    let mut start = start.to_vec();
    for _ in 0..CORRECTIONS {
        let activity = viscous.remembered_at(problem.activity, step, &start);
        let problem = Problem {
            activity: &activity,
            laplacian: problem.laplacian,
            material: &problem.material,
            tolerance: problem.tolerance,
            at_rest: None,
        };
        let before = total.steps;
        let reached = charge::near(&problem, scene, charge, &start, (&mut *workspace, &mut *total))?;
        // The stress of the branches after a step of zero length is that with which the state was found.
        if !viscous.depends_on_end(step) || total.steps == before {
            return Ok(reached);
        }
        start = reached.u;
    }
    Err(charge::ChargeFailure::Unknown)
}
