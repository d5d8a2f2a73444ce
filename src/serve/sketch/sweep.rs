//! Simulates a drawn pattern at rising voltages: from rest to its critical voltage, or to the requested voltage.

use rayon::prelude::*;
use serde_json::json;

use super::request::SketchRequest;
use super::solve::{START_VOLTAGE, SketchSolution, critical_voltage};
use crate::artifact_data::field_array;
use crate::cache::{PreparedSolver, SimulationSetup};
use crate::http::{ApiError, Array, Request, Response, frame};
use crate::state::ServerState;
use deaflow_fem::effects::{breakdown_ratio, breakdown_strength_or_default};

/// Steps of the voltage.
const STEPS: usize = 24;

/// Simulates a pattern at rising voltages. The answer is a frame: `points` with the voltage, the largest displacement
/// and the value of each solution, its largest electric field relative to the breakdown field, and their
/// displacements in one array `[point][y][x][xy]`. The last voltage is the critical one, or the highest stable one of
/// the mesh if that is lower; without a critical voltage, the requested one. `breakdown_assumed` says whether the
/// breakdown field is that of the usual acrylic elastomer, as the scene has none.
///
/// # Errors
/// If the request is invalid, or the scene cannot be simulated.
pub fn sweep(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let drawn: SketchRequest = request.json()?;
    let setup = drawn.setup(state)?;
    if setup.scene.drive.charge.is_some() {
        return Err(ApiError::bad_request(
            "the scene is driven by a charge; a sweep needs a voltage",
        ));
    }
    let pattern = drawn.pattern(&setup.scene)?;
    let goal = drawn.goal(&setup.scene, None, false)?;
    let prepared = state.solvers.solver(&setup)?;
    let critical = critical_voltage(state, &setup, &prepared, &pattern)?;
    let last = critical.map_or(setup.scene.voltage_v(), |found| found.voltage.min(found.bracket[0]));
    if last <= START_VOLTAGE {
        return Err(ApiError::bad_request("the voltage is 0").help("raise the voltage"));
    }
    let strength = breakdown_strength_or_default(&setup.scene);
    let at = |step: usize| {
        // Not 0: the ratios of several groups are kept.
        let voltage = (last * step as f64 / STEPS as f64).max(START_VOLTAGE);
        // The effects stay as they are: screening at another voltage could select others.
        let scene = prepared
            .scene
            .at_voltage(voltage)
            .with_effects(prepared.scene.effects.clone());
        let own = SimulationSetup { scene, ..setup.clone() };
        let prepared = PreparedSolver::new(&own)?;
        let solution = SketchSolution::new(&own, &prepared, &pattern)?;
        let cells = solution.cells(&prepared, &pattern)?;
        let field = cells.map(|cells| breakdown_ratio(&strength, own.scene.thickness_mm(), &cells));
        Ok::<_, ApiError>((voltage, solution.simulation, field))
    };
    let all: Vec<_> = (0..=STEPS).into_par_iter().map(at).collect::<Result<_, _>>()?;
    let (mut points, mut values, mut shape) = (Vec::new(), Vec::new(), Vec::new());
    for (voltage, simulation, breakdown) in &all {
        // Beyond the first voltage without a stable state there is none on this mesh.
        let Some(field) = &simulation.field else { break };
        points.push(json!({
            "voltage": voltage,
            "max_displacement": field.max_magnitude(),
            "value": goal.as_ref().map(|goal| goal.value_mm(std::slice::from_ref(field))),
            "breakdown_ratio": breakdown,
        }));
        if let Array::Numbers(own, numbers) = field_array(field) {
            shape = own;
            values.extend(numbers);
        }
    }
    shape.insert(0, points.len());
    let document = json!({
        "points": points,
        "critical_voltage": critical.map(|found| found.voltage),
        "critical_voltage_error": critical.and_then(|found| found.error),
        "breakdown_assumed": setup.scene.breakdown_strength().is_none(),
    });
    let arrays = [("displacement".to_owned(), Array::Numbers(shape, values))];
    Ok(Response::frame(frame(document, &arrays)))
}
