//! Simulates a drawn pattern: numbers, and fields if they are requested.

use std::time::Instant;

use serde_json::{Value, json};

use super::request::SketchRequest;
use super::rising::voltage_limits;
use crate::artifact_data::field_array;
use crate::cache::{CriticalVoltage, PreparedSolver, SimulationSetup};
use crate::http::{ApiError, Array, Request, Response, frame};
use crate::state::ServerState;
use deaflow_design::Goal;
use deaflow_fem::{CellState, CriticalSearch, MeshSolution, Method, SetupError, SolveOptions};
use deaflow_field::{Field, Simulation};
use deaflow_pattern::Pattern;

/// Fields that can be requested.
const FIELDS: [&str; 5] = ["displacement", "stress", "field", "tension", "sensitivity"];

/// The voltage in V at which the search for the critical voltage starts: the deformation is negligible, and the ratios
/// of several groups are kept.
pub(super) const START_VOLTAGE: f64 = 1.0;

/// Simulates a pattern.
///
/// # Errors
/// If the request is invalid, or the scene cannot be simulated.
pub fn solve(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let drawn: SketchRequest = request.json()?;
    if let Some(other) = drawn.fields.iter().find(|field| !FIELDS.contains(&field.as_str())) {
        return Err(
            ApiError::bad_request(format!("unknown field {other:?}")).help(format!("allowed: {}", FIELDS.join(", ")))
        );
    }
    let setup = drawn.setup(state)?;
    let pattern = drawn.pattern(&setup.scene)?;
    let goal = drawn.goal(&setup.scene, None, false)?;
    let solver = state.solvers.solver(&setup)?;
    let solution = SketchSolution::new(&setup, &solver, &pattern)?;
    let mut document = solution.document(&setup, &pattern, goal.as_ref());
    if !drawn.quick {
        let critical = critical_voltage(state, &setup, &solver, &pattern)?;
        document["critical_voltage"] = json!(critical.map(|found| found.voltage));
        document["critical_voltage_error"] = json!(critical.and_then(|found| found.error));
        document["critical_bracket"] = json!(critical.map(|found| found.bracket));
        let limits = voltage_limits(state, &setup, &solver, &pattern, critical)?;
        document["breakdown_voltage"] = json!(limits.breakdown);
        document["wrinkling_voltage"] = json!(limits.wrinkling);
        document["error"] = json!(solution.error(state, &setup, &pattern)?);
    }
    if drawn.fields.is_empty() {
        return Ok(document.into());
    }
    let wants = |field: &str| drawn.fields.iter().any(|requested| requested == field);
    let mut arrays = Vec::new();
    let [columns, rows] = pattern.raster().sides();
    let mut add = |name: &str, array: Array| arrays.push((name.to_owned(), array));
    if let Some(field) = solution.simulation.field.as_ref().filter(|_| wants("displacement")) {
        add("displacement", field_array(field));
    }
    if ["stress", "field", "tension"].into_iter().any(wants)
        && let Some(cells) = solution.cells(&solver, &pattern)?
    {
        let each = |of: fn(&CellState) -> f64| {
            Array::Numbers(vec![rows, columns], cells.iter().map(|cell| of(cell) as f32).collect())
        };
        if wants("stress") {
            add("stress", each(|cell| cell.stresses[0]));
            add("least_stress", each(|cell| cell.stresses[1]));
        }
        if wants("field") {
            add("field", each(|cell| cell.electric_field));
        }
        if wants("tension") {
            let codes = cells.iter().map(|cell| cell.tension.code()).collect();
            add("tension", Array::Bytes(vec![rows, columns], codes));
        }
    }
    if let Some(goal) = goal.as_ref().filter(|_| wants("sensitivity")) {
        // With several electrode groups, the derivative is split by the load of each group.
        if let Some(gradient) = solution.sensitivity(&solver, &pattern, goal)? {
            let values = gradient.iter().map(|value| *value as f32).collect();
            add("sensitivity", Array::Numbers(vec![rows, columns], values));
        }
    }
    Ok(Response::frame(frame(document, &arrays)))
}

/// Finds the critical voltage of a pattern, which does not depend on the requested voltage. `None` if there is none, or
/// the method is an estimate.
pub(super) fn critical_voltage(
    state: &ServerState,
    setup: &SimulationSetup,
    solver: &PreparedSolver,
    pattern: &Pattern,
) -> Result<Option<CriticalVoltage>, ApiError> {
    if setup.method != Method::Newton || solver.scene.drive.charge.is_some() || pattern.active_cells() == 0 {
        return Ok(None);
    }
    // The effects stay as they are: screening at another voltage could select others.
    let scene = solver
        .scene
        .at_voltage(START_VOLTAGE)
        .with_effects(solver.scene.effects.clone());
    let setup = SimulationSetup { scene, ..setup.clone() };
    let key = (setup, pattern.clone());
    let critical = state.critical_voltages.get_or_insert(&key, || {
        let prepared = state.solvers.solver(&key.0)?;
        let solver = prepared.solver.on_one_mesh()?;
        let bracket = solver.stability(pattern, &solver.solve(pattern)).critical;
        Ok::<_, ApiError>(bracket.map(|bracket| refine(&key.0, pattern, bracket)).transpose()?)
    })?;
    Ok(*critical)
}

/// Refines the critical voltage on two biquadratic meshes; `bracket` has the voltages in V on the mesh of the request.
fn refine(setup: &SimulationSetup, pattern: &Pattern, bracket: [f64; 2]) -> Result<CriticalVoltage, SetupError> {
    let middle = 0.5 * (bracket[0] + bracket[1]);
    let scene = setup.scene.at_voltage(middle).with_effects(setup.scene.effects.clone());
    // The usual finer meshes would take too long here.
    let search = CriticalSearch::for_solutions_on(&scene, SolveOptions::on(setup.mesh))?;
    let found = search.from(pattern, setup.mesh, middle);
    Ok(CriticalVoltage {
        voltage: found.voltage,
        error: found.error,
        bracket,
    })
}

/// A solution.
pub(super) struct SketchSolution {
    /// Outcome, field and observations.
    pub(super) simulation: Simulation,
    /// The solution on the mesh, if the method is Newton's.
    on_mesh: Option<MeshSolution>,
    seconds: f64,
}

impl SketchSolution {
    /// Simulates a pattern.
    ///
    /// # Errors
    /// If it cannot be simulated by the method.
    pub(super) fn new(
        setup: &SimulationSetup,
        prepared: &PreparedSolver,
        pattern: &Pattern,
    ) -> Result<Self, SetupError> {
        let start = Instant::now();
        if setup.method == Method::Newton {
            let solver = prepared.solver.on_one_mesh()?;
            let on_mesh = solver.solve(pattern);
            let seconds = start.elapsed().as_secs_f64();
            return Ok(Self {
                simulation: solver.simulation(pattern, &on_mesh),
                on_mesh: Some(on_mesh),
                seconds,
            });
        }
        let mut found = prepared.solver.simulate(std::slice::from_ref(pattern))?;
        Ok(Self {
            seconds: start.elapsed().as_secs_f64(),
            simulation: found.swap_remove(0).simulation,
            on_mesh: None,
        })
    }

    fn document(&self, setup: &SimulationSetup, pattern: &Pattern, goal: Option<&Goal>) -> Value {
        let simulation = &self.simulation;
        let field = simulation.field.as_ref();
        let value = |goal: &Goal| field.map(|field| goal.value_mm(std::slice::from_ref(field)));
        json!({
            "outcome": simulation.outcome.kind(),
            "max_displacement": field.map(Field::max_magnitude),
            "value": goal.and_then(value),
            "critical_voltage": null,
            "critical_voltage_error": null,
            "critical_bracket": null,
            "breakdown_voltage": null,
            "wrinkling_voltage": null,
            "error": null,
            "seconds": self.seconds,
            "bracket": simulation.outcome.bracket(),
            "voltage": setup.scene.voltage_v(),
            "method": setup.method.to_string(),
            "elements_per_cell": setup.mesh.elements_per_cell(),
            "order": setup.mesh.order().degree(),
            "area": setup.scene.area_fraction(pattern),
            "newton_iterations": simulation.newton_iterations,
            "breakdown_ratio": simulation.observation.breakdown_ratio,
            "smallest_eigenvalue": simulation.observation.smallest_eigenvalue,
        })
    }

    /// Returns the largest difference in mm, over the cell corners, from Newton's method on a finer mesh; `None` if one
    /// of them has no field.
    fn error(&self, state: &ServerState, setup: &SimulationSetup, pattern: &Pattern) -> Result<Option<f64>, ApiError> {
        let Some(field) = &self.simulation.field else {
            return Ok(None);
        };
        let Some(finer) = state.solvers.finer(setup)? else {
            return Ok(None);
        };
        let finer = finer.solver.simulate(std::slice::from_ref(pattern))?.swap_remove(0);
        Ok(finer.simulation.field.map(|finer| field.max_difference(&finer)))
    }

    /// Returns the state of each cell; `None` without a stable solution by Newton's method.
    pub(super) fn cells(
        &self,
        prepared: &PreparedSolver,
        pattern: &Pattern,
    ) -> Result<Option<Vec<CellState>>, SetupError> {
        let Some(on_mesh) = self.on_mesh.as_ref().filter(|solution| solution.outcome.is_converged()) else {
            return Ok(None);
        };
        Ok(Some(prepared.solver.on_one_mesh()?.cell_states(pattern, on_mesh)))
    }

    /// Returns the derivative of the value with respect to the activity of each cell, mm; `None` if there is no
    /// adjoint.
    fn sensitivity(
        &self,
        prepared: &PreparedSolver,
        pattern: &Pattern,
        goal: &Goal,
    ) -> Result<Option<Vec<f64>>, SetupError> {
        let (Some(on_mesh), Some(field)) = (&self.on_mesh, &self.simulation.field) else {
            return Ok(None);
        };
        let slope = goal.slope(std::slice::from_ref(field)).swap_remove(0);
        Ok(prepared.solver.on_one_mesh()?.gradient(pattern, on_mesh, &slope))
    }
}
