//! The best design of a report as the voltage rises.

use deaflow_fem::screening::resolve;
use deaflow_fem::{MembraneSolver, PathParameter, PathSolver, SolveOptions};
use deaflow_field::{Field, Mesh};
use deaflow_report::{Design, VoltageSweep, best_design};
use deaflow_scene::Scene;

/// The mesh: a picture needs no finer one.
const MESH: Mesh = Mesh::bilinear(1);

/// Shares of the last voltage that are drawn besides that of the scene: closer where the membrane moves faster.
const SHARES: [f64; 8] = [0.0, 0.3, 0.5, 0.65, 0.8, 0.9, 0.96, 1.0];

/// Limits beyond this multiple of the voltage of the scene are not drawn: the design would hardly move at its own.
const FARTHEST: f64 = 3.0;

/// Simulates the best design from rest to the limit of its stability, or to the voltage of the scene if the limit is far
/// or there is none. `None` if there is no design of a search, if it has several states, voltages or a charge, if it
/// moves in time, out of the plane or at free sides, or if it has no solution on a coarse mesh: it is drawn at rest and
/// at its voltage then.
pub fn voltage_sweep(designs: &[Design]) -> Option<VoltageSweep> {
    let design = best_design(designs)?;
    let scene = resolve(&design.scene).ok()?;
    let [volts] = scene.drive.voltages.in_volts()[..] else {
        return None;
    };
    let drive = &scene.drive;
    let is_at_rest = design.objective.moment.is_none() && drive.waveform.is_none();
    let is_plain = is_at_rest && drive.charge.is_none() && design.states.is_empty();
    if !is_plain || scene.loads.is_some() || scene.is_in_space() || scene.geometry.sides.is_some() {
        return None;
    }
    let options = SolveOptions {
        mesh: MESH,
        ..SolveOptions::default()
    };
    let path = PathSolver::new(&scene, options, PathParameter::Voltage).ok()?;
    let path = path.path(&design.pattern).ok()?;
    let limit = path.limit().filter(|limit| limit.voltage <= FARTHEST * volts);
    let last = limit.map_or(volts, |limit| limit.voltage);
    let mut voltages: Vec<f64> = SHARES.iter().map(|share| share * last).chain([volts]).collect();
    voltages.sort_by(f64::total_cmp);
    voltages.retain(|voltage| *voltage <= last);
    voltages.dedup();
    let state = |voltage: f64| match limit {
        Some(limit) if voltage == limit.voltage => Some((voltage, path.limit_field.clone())),
        _ => Some((voltage, solve(&scene.at_voltage(voltage), options, design)?)),
    };
    Some(VoltageSweep {
        design: design.name.clone(),
        voltage: volts,
        states: voltages.into_iter().map(state).collect::<Option<_>>()?,
        ends_at_limit: limit.is_some(),
    })
}

fn solve(scene: &Scene, options: SolveOptions, design: &Design) -> Option<Field> {
    let solver = MembraneSolver::new(scene, options).ok()?;
    let solution = solver.solve(&design.pattern);
    solution.outcome.has_field().then(|| solver.field(&solution))
}
