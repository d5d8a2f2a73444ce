//! `deaflow solve` without a further form: the equilibrium of each pattern, in each state of the scene.

use serde_json::json;

use super::equilibria::{Equilibria, SolveRequest, Solved, StateRun};
use super::figure::Membrane;
use super::simulation::{Form, Simulation, States};
use super::{SolveArguments, figure, inflation};
use crate::job::JobResult;
use crate::point::Probe;
use crate::results::{AccuracyResult, CriticalBracket, Peak, SampleId, SampleResult, document, remarks, text};
use crate::side_results::SideResults;
use crate::{CliError, Exit, Output};
use deaflow_content::SolveFile;
use deaflow_fem::{AccurateSimulation, MeshRequest, SolverParameters, wrinkled_fraction};
use deaflow_field::Order;
use deaflow_stage as stage;

/// A note on critical voltages of bilinear elements.
const BILINEAR: &str =
    "bilinear elements overestimate critical voltages: use --order 2, or --path for a voltage with its error";

/// A note on critical voltages of other elements.
const ONE_MESH: &str = "critical voltages of a single mesh are slightly too high: --path estimates their error";

/// What `--no-checks` leaves open.
const NOT_CHECKED: &str = "not checked, because of --no-checks: whether a finer mesh finds a stable solution, and how \
                           much neglected effects would change the displacement";

pub const FORM: Form = Form {
    name: "solve",
    has_attachments: false,
    states: States::Each,
    without_covered_cells: None,
    without_pressure: None,
};

/// Finds the equilibria of patterns.
///
/// # Errors
/// When the scene or a pattern cannot be used, or the file cannot be written.
pub fn execute(arguments: &SolveArguments, output: &Output) -> Result<Exit, CliError> {
    let simulation = Simulation::read(arguments, &FORM)?;
    if simulation.scene.is_in_space() {
        return inflation::execute(simulation, output);
    }
    let scene = &simulation.scene;
    if let Some(faint) = stage::weak_drive_warning(&scene.at_largest_voltages()) {
        output.warn(faint);
    }
    let probe = arguments.point.on(scene)?;
    let equilibria = Equilibria::new(scene, &simulation.parameters)?;
    let request = SolveRequest {
        patterns: &simulation.patterns,
        drawings: &simulation.drawings,
        cells: arguments.cells,
        checks: !arguments.no_checks,
    };
    let solved = equilibria.solve(&request, &simulation.job.bar)?;
    let results = results(&simulation, &solved, probe);
    let warnings = solved.warnings();
    let (at_point, point) = probe
        .map(|probe| probe.of_all(solved.fields().map(|field| field.map(|field| probe.of(field)))))
        .unzip();
    let content = SolveFile {
        at_point,
        point,
        ..solved.content()
    };
    let mut report = text(&results, arguments.patterns.output.as_deref(), probe.as_ref());
    report.append(remarks(
        &results,
        critical_note(solved.runs(), &results, &simulation.parameters),
    ));
    if arguments.no_checks {
        report.line(NOT_CHECKED);
    }
    let mut found = document(&results, simulation.patterns.len(), probe.as_ref());
    found["checks"] = json!(!arguments.no_checks);
    let drawn = solved.samples().zip(solved.fields());
    let drawn: Vec<Membrane<'_>> = drawn
        .map(|((index, run), displacement)| Membrane {
            index,
            state: run.state.clone(),
            displacement,
            heights: None,
        })
        .collect();
    let figure = figure::draw(&simulation, &drawn, probe.as_ref(), output);
    let is_unstable = results.iter().any(|result| result.failure.is_some());
    let result = JobResult {
        patterns: simulation.patterns.len(),
        arrays: content.in_states(&equilibria.states()),
        parameters: simulation.described(""),
        attachments: None,
        warnings,
        document: found,
        text: report,
        exit: if is_unstable { Exit::Unstable } else { Exit::Done },
    };
    simulation.with_figure(figure).finish(result, output)
}

fn results(simulation: &Simulation<'_>, solved: &Solved<'_>, probe: Option<Probe>) -> Vec<SampleResult> {
    let cell_mm = simulation.scene.membrane().cell_mm();
    let accuracy_mm = simulation.parameters.accuracy().map(|accuracy| accuracy.value());
    let result = |(index, run): (usize, &StateRun)| {
        let AccurateSimulation {
            simulation: solution,
            mesh,
            discretisation_error,
            geometry_error,
        } = &run.solutions[index];
        // Critical voltages of different meshes would contradict each other without the mesh.
        let on = accuracy_mm.map_or_else(String::new, |_| format!(", on {mesh}"));
        let field = solution.field.as_ref();
        let effects = &run.screened.scene.effects;
        let is_searched = effects.electromechanical_stability.is_some();
        let is_observed = effects.dielectric_breakdown.is_some();
        SampleResult {
            id: SampleId {
                index,
                state: run.state.clone(),
            },
            file: simulation.names[index].clone(),
            outcome: solution.outcome.kind(),
            failure: field.is_none().then(|| format!("{}{on}", solution.outcome)),
            peak: field.map(|field| Peak::of(field, Some(cell_mm))),
            along_mm: field.and_then(|field| Some(probe?.of(field))),
            along_from_rest_mm: probe
                .filter(|_| run.screened.scene.geometry.sides.is_some())
                .zip(solution.stroke())
                .map(|(probe, stroke)| probe.of(&stroke)),
            accuracy: accuracy_mm.map(|accuracy| AccuracyResult {
                mesh: *mesh,
                mesh_error_mm: *discretisation_error,
                geometry_error: *geometry_error,
                accuracy_mm: accuracy,
            }),
            wrinkled_fraction: run
                .cells
                .get(index)
                .and_then(|cells| Some(wrinkled_fraction(cells.as_deref()?))),
            is_checked: !simulation.arguments.no_checks,
            near_limit: run.near_limit[index],
            sides: SideResults::of(&run.screened.scene, solution),
            bodies: field
                .and_then(|_| solution.observation.bodies.clone())
                .unwrap_or_default(),
            breakdown_ratio: solution.observation.breakdown_ratio.filter(|_| is_observed),
            critical: is_searched.then_some(CriticalBracket {
                mesh: *mesh,
                on,
                between: solution.observation.critical_voltage,
            }),
        }
    };
    solved.samples().map(result).collect()
}

/// The note that critical voltages need, if any were found.
fn critical_note(runs: &[StateRun], results: &[SampleResult], parameters: &SolverParameters) -> Option<&'static str> {
    let is_bilinear = matches!(parameters.mesh_request(), MeshRequest::Fixed(mesh) if mesh.order() == Order::Bilinear);
    let is_found = |result: &SampleResult| {
        let is_told_with_error = result.near_limit.flatten().is_some();
        !is_told_with_error && result.critical.as_ref().is_some_and(|found| found.between.is_some())
    };
    let mut solutions = runs.iter().flat_map(|run| &run.solutions);
    let is_any_found = results.iter().any(is_found);
    // A membrane that is unstable without voltage has no critical voltage.
    let is_bracketed =
        |found: &AccurateSimulation| found.simulation.outcome.bracket().is_some_and(|[_, upper]| upper > 0.0);
    match is_bilinear {
        true => (is_any_found || solutions.any(is_bracketed)).then_some(BILINEAR),
        false => is_any_found.then_some(ONE_MESH),
    }
}
