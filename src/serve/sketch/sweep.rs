//! Simulates a drawn pattern at rising voltages: from rest to its critical voltage, or to the requested voltage.

use serde_json::json;

use super::request::SketchRequest;
use super::rising::{crossing, last_voltage, rising, voltage_limits};
use super::solve::{START_VOLTAGE, critical_voltage};
use crate::artifact_data::field_array;
use crate::http::{ApiError, Array, Request, Response, frame};
use crate::state::ServerState;

/// Simulates a pattern at rising voltages. The answer is a frame: `points` with the voltage, the largest displacement
/// and the value of each solution, its largest electric field relative to the breakdown field, and their
/// displacements in one array `[point][y][x][xy]`. The last voltage is the critical one, or the highest stable one of
/// the mesh if that is lower; without a critical voltage, the requested one. `breakdown_voltage` is where the breakdown
/// field is reached; `breakdown_assumed` says whether that is the one of the usual acrylic elastomer, as the scene has
/// none. From `wrinkling_voltage` on, the membrane wrinkles.
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
    let last = last_voltage(&setup, critical);
    if last <= START_VOLTAGE {
        return Err(ApiError::bad_request("the voltage is 0").help("raise the voltage"));
    }
    let all = rising(&setup, &prepared, &pattern, last)?;
    let limits = voltage_limits(state, &setup, &prepared, &pattern, critical)?;
    let (mut points, mut values, mut shape) = (Vec::new(), Vec::new(), Vec::new());
    for point in &all {
        let Some(field) = point.field() else { break };
        points.push(json!({
            "voltage": point.voltage,
            "max_displacement": field.max_magnitude(),
            "value": goal.as_ref().map(|goal| goal.value_mm(std::slice::from_ref(field))),
            "breakdown_ratio": point.breakdown,
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
        "breakdown_voltage": limits.breakdown.or_else(|| crossing(&all, |point| point.breakdown)),
        "breakdown_assumed": setup.scene.breakdown_strength().is_none(),
        "wrinkling_voltage": limits.wrinkling,
    });
    let arrays = [("displacement".to_owned(), Array::Numbers(shape, values))];
    Ok(Response::frame(frame(document, &arrays)))
}
