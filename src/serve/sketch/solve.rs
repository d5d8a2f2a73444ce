//! What a drawn pattern does: numbers, and fields where they are asked for.

use std::sync::Arc;
use std::time::Instant;

use serde_json::{Value, json};

use super::drawn::Drawn;
use crate::held::{Bench, Critical, Setting};
use crate::http::{Answer, Array, Refusal, Request, frame};
use crate::state::ServedState;
use deaflow_design::Goal;
use deaflow_fem::{CellState, CriticalSearch, MeshSolution, Method, SetupError, SolveOptions};
use deaflow_field::{Field, Simulation};
use deaflow_pattern::Pattern;

/// What can be told of each corner or cell.
const FIELDS: [&str; 5] = ["displacement", "stress", "field", "tension", "sensitivity"];

/// The voltage in V from which the limit is looked for: it moves nothing that could be seen, and keeps the ratios of several groups.
const NEARLY_REST: f64 = 1.0;

/// Simulates a pattern.
///
/// # Errors
/// When the request is not understood, or the scene cannot be simulated.
pub fn solve(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let drawn: Drawn = request.json()?;
    if let Some(other) = drawn.fields.iter().find(|field| !FIELDS.contains(&field.as_str())) {
        return Err(
            Refusal::bad(format!("there is no field {other:?}")).help(format!("allowed: {}", FIELDS.join(", ")))
        );
    }
    let setting = drawn.setting(state)?;
    let pattern = drawn.pattern(&setting.scene)?;
    let goal = drawn.goal(&setting.scene, None, false)?;
    let bench = state.benches.solver(&setting)?;
    let solved = Solved::new(&setting, &bench, &pattern)?;
    let mut document = solved.document(&setting, &pattern, goal.as_ref());
    if !drawn.quick {
        let critical = critical_voltage(state, &setting, &bench, &pattern)?;
        document["critical_voltage"] = json!(critical.map(|found| found.voltage));
        document["critical_voltage_error"] = json!(critical.and_then(|found| found.error));
        document["critical_bracket"] = json!(critical.map(|found| found.bracket));
        document["error"] = json!(solved.error(state, &setting, &pattern)?);
    }
    if drawn.fields.is_empty() {
        return Ok(document.into());
    }
    let wants = |field: &str| drawn.fields.iter().any(|wanted| wanted == field);
    let mut arrays = Vec::new();
    let [columns, rows] = pattern.raster().sides();
    let mut add = |name: &str, array: Array| arrays.push((name.to_owned(), array));
    if let Some(field) = solved.simulation.field.as_ref().filter(|_| wants("displacement")) {
        let values = field.values().iter().map(|value| *value as f32).collect();
        add("displacement", Array::Numbers(vec![rows + 1, columns + 1, 2], values));
    }
    if ["stress", "field", "tension"].into_iter().any(wants)
        && let Some(cells) = solved.cells(&bench, &pattern)?
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
        // Of several groups of electrodes that of the drawn one is told by its share of the load.
        if let Some(gradient) = solved.sensitivity(&bench, &pattern, goal)? {
            let values = gradient.iter().map(|value| *value as f32).collect();
            add("sensitivity", Array::Numbers(vec![rows, columns], values));
        }
    }
    Ok(Answer::frame(frame(document, &arrays)))
}

/// Where stability is lost, from rest on: it is that of the pattern, whatever voltage is asked for.
/// `None` where that is not found, or an estimate says nothing of it.
fn critical_voltage(
    state: &ServedState,
    setting: &Setting,
    bench: &Bench,
    pattern: &Pattern,
) -> Result<Option<Critical>, Refusal> {
    if setting.method != Method::Newton || bench.scene.drive.charge.is_some() || pattern.active_cells() == 0 {
        return Ok(None);
    }
    // With the effects as they are: what screening makes of another voltage is another model.
    let scene = bench
        .scene
        .at_voltage(NEARLY_REST)
        .with_effects(bench.scene.effects.clone());
    let setting = Setting {
        scene,
        ..setting.clone()
    };
    let key = (setting, pattern.clone());
    if let Some(known) = state.limits.get(&key) {
        return Ok(*known);
    }
    let bench = state.benches.solver(&key.0)?;
    let solver = bench.solver.on_one_mesh()?;
    let bracket = solver.stability(pattern, &solver.solve(pattern)).critical;
    let found = match bracket {
        Some(bracket) => Some(refined(&key.0, pattern, bracket)?),
        None => None,
    };
    state.limits.put(key, &Arc::new(found));
    Ok(found)
}

/// The critical voltage by two biquadratic meshes, of which the loss between two voltages in V on the mesh of a setting says where to look.
fn refined(setting: &Setting, pattern: &Pattern, bracket: [f64; 2]) -> Result<Critical, SetupError> {
    let middle = 0.5 * (bracket[0] + bracket[1]);
    let scene = setting
        .scene
        .at_voltage(middle)
        .with_effects(setting.scene.effects.clone());
    // On no finer meshes than watch over solutions elsewhere: somebody waits.
    let search = CriticalSearch::beside(&scene, SolveOptions::on(setting.mesh))?;
    let found = search.from(pattern, setting.mesh, middle);
    Ok(Critical {
        voltage: found.voltage,
        error: found.error,
        bracket,
    })
}

/// A solution.
struct Solved {
    simulation: Simulation,
    /// With the resolution of the mesh, where the method is Newton's.
    whole: Option<MeshSolution>,
    seconds: f64,
}

impl Solved {
    fn new(setting: &Setting, bench: &Bench, pattern: &Pattern) -> Result<Self, SetupError> {
        let start = Instant::now();
        if setting.method == Method::Newton {
            let solver = bench.solver.on_one_mesh()?;
            let whole = solver.solve(pattern);
            let seconds = start.elapsed().as_secs_f64();
            return Ok(Self {
                simulation: solver.simulation(pattern, &whole),
                whole: Some(whole),
                seconds,
            });
        }
        let mut found = bench.solver.simulate(std::slice::from_ref(pattern))?;
        Ok(Self {
            seconds: start.elapsed().as_secs_f64(),
            simulation: found.swap_remove(0).simulation,
            whole: None,
        })
    }

    fn document(&self, setting: &Setting, pattern: &Pattern, goal: Option<&Goal>) -> Value {
        let simulation = &self.simulation;
        let field = simulation.field.as_ref();
        let value = |goal: &Goal| field.map(|field| goal.value_mm(std::slice::from_ref(field)));
        json!({
            "outcome": simulation.outcome.name(),
            "max_displacement": field.map(Field::max_magnitude),
            "value": goal.and_then(value),
            "critical_voltage": null,
            "critical_voltage_error": null,
            "critical_bracket": null,
            "error": null,
            "seconds": self.seconds,
            "bracket": simulation.outcome.bracket(),
            "voltage": setting.scene.voltage_v(),
            "method": setting.method.to_string(),
            "elements_per_cell": setting.mesh.elements_per_cell(),
            "order": setting.mesh.order().degree(),
            "area": pattern.area_fraction(),
            "newton_iterations": simulation.newton_iterations,
            "breakdown_ratio": simulation.observation.breakdown_ratio,
            "smallest_eigenvalue": simulation.observation.smallest_eigenvalue,
        })
    }

    /// The largest difference in mm, over the cell corners, from Newton's method on a finer mesh; `None` where one of them has no field.
    fn error(&self, state: &ServedState, setting: &Setting, pattern: &Pattern) -> Result<Option<f64>, Refusal> {
        let Some(field) = &self.simulation.field else {
            return Ok(None);
        };
        let Some(bench) = state.benches.finer(setting)? else {
            return Ok(None);
        };
        let finer = bench.solver.simulate(std::slice::from_ref(pattern))?.swap_remove(0);
        Ok(finer.simulation.field.map(|finer| field.max_difference(&finer)))
    }

    /// The state of each cell; `None` without a stable solution by Newton's method.
    fn cells(&self, bench: &Bench, pattern: &Pattern) -> Result<Option<Vec<CellState>>, SetupError> {
        let Some(whole) = self.whole.as_ref().filter(|whole| whole.outcome.is_converged()) else {
            return Ok(None);
        };
        Ok(Some(bench.solver.on_one_mesh()?.cell_states(pattern, whole)))
    }

    /// How the value changes with the activity of each cell, mm; `None` where there is no adjoint.
    fn sensitivity(&self, bench: &Bench, pattern: &Pattern, goal: &Goal) -> Result<Option<Vec<f64>>, SetupError> {
        let (Some(whole), Some(field)) = (&self.whole, &self.simulation.field) else {
            return Ok(None);
        };
        let slope = goal.slope(std::slice::from_ref(field)).swap_remove(0);
        Ok(bench.solver.on_one_mesh()?.gradient(pattern, whole, &slope))
    }
}
