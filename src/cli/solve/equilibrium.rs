//! `deaflow solve` without a further form: the equilibrium of each pattern, in each state of the scene.

use std::time::Instant;

use rayon::prelude::*;
use serde_json::json;

use super::simulation::{Form, PatternSolver, Simulation, States};
use super::{SolveArguments, cells, inflation};
use crate::job::{JobResult, seconds_each};
use crate::point::Probe;
use crate::results::{AccuracyResult, CriticalBracket, Peak, SampleId, SampleResult, document, remarks, text};
use crate::side_results::SideResults;
use crate::{CliError, Exit, Output};
use deaflow_base::Progress;
use deaflow_content::{CoveredCells, DrawnElectrodes, Lines, Observations, Packed, SolveFile};
use deaflow_fem::effects::Examined;
use deaflow_fem::screening::{ScreenedScene, TestPattern, examined, observing_breakdown, resolve, resolve_states};
use deaflow_fem::{
    AccurateSimulation, CriticalSearch, CriticalVoltage, GeometryErrors, MeshRequest, Method, SetupError, SolveOptions,
    Solver, SolverParameters, wrinkled_fraction,
};
use deaflow_field::{Field, Mesh, Order};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_stage as stage;
use deaflow_stage::solution;

/// Patterns that one thread solves between two reports of progress.
const BATCH: usize = 8;

/// A note on critical voltages of bilinear elements.
const BILINEAR: &str =
    "bilinear elements overestimate critical voltages: use --order 2, or --path for a voltage with its error";

/// A note on critical voltages of other elements.
const ONE_MESH: &str = "critical voltages of a single mesh are slightly too high: --path estimates their error";

/// What `--no-checks` leaves open.
const NOT_CHECKED: &str = "not checked, because of --no-checks: whether a finer mesh finds a stable solution, and how \
                           much neglected effects would change the displacement";

/// What warnings call a pattern.
const NAME: &str = "pattern";

const FORM: Form = Form {
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
    let parameters = arguments.parameters();
    let mut runs = Vec::new();
    for (name, scene) in resolve_states(scene)?.in_states() {
        let state = (!name.is_empty()).then(|| name.to_owned());
        runs.push(StateRun::new(state, &scene, &simulation, &parameters)?);
    }
    let results = results(&simulation, &runs, &parameters, probe);
    let warnings: Vec<String> = runs.iter().flat_map(StateRun::warnings).collect();
    let states: Vec<String> = runs.iter().filter_map(|run| run.state.clone()).collect();
    let arrays = content(&simulation, &runs, probe, &warnings).in_states(&states);
    let mut report = text(&results, arguments.patterns.output.as_deref(), probe.as_ref());
    report.append(remarks(&results, critical_note(&runs, &results, &parameters)));
    if arguments.no_checks {
        report.line(NOT_CHECKED);
    }
    let mut found = document(&results, simulation.patterns.len(), probe.as_ref());
    found["checks"] = json!(!arguments.no_checks);
    let is_unstable = results.iter().any(|result| result.failure.is_some());
    let result = JobResult {
        patterns: simulation.patterns.len(),
        arrays,
        parameters: simulation.parameters(""),
        attachments: None,
        warnings,
        document: found,
        text: report,
        exit: if is_unstable { Exit::Unstable } else { Exit::Done },
    };
    simulation.finish(result, output)
}

/// What the patterns do in one state.
struct StateRun {
    state: Option<String>,
    screened: ScreenedScene,
    solver: Solver,
    solutions: Vec<AccurateSimulation>,
    seconds: Vec<f64>,
    /// The states of the cells, if they were requested.
    cells: Vec<cells::States>,
    /// By pattern, as in [`SampleResult::near_limit`].
    near_limit: Vec<Option<Option<CriticalVoltage>>>,
}

impl StateRun {
    fn new(
        state: Option<String>,
        scene: &Scene,
        simulation: &Simulation<'_>,
        parameters: &SolverParameters,
    ) -> Result<Self, CliError> {
        let patterns = &simulation.patterns;
        let scene = resolve(scene)?;
        let solver = parameters.build(&observing_breakdown(&scene))?;
        let threads = rayon::current_num_threads();
        let mut solutions = Vec::with_capacity(patterns.len());
        let errors = match parameters.accuracy() {
            Some(_) => GeometryErrors::new(&scene, parameters, simulation.drawings != *patterns)?,
            None => None,
        };
        let mut seconds = Vec::with_capacity(patterns.len());
        let mut cells = Vec::new();
        // The first batch is small, so that the pace is known early.
        let (first, rest) = patterns.split_at(threads.min(patterns.len()));
        for batch in std::iter::once(first).chain(rest.chunks(BATCH * threads)) {
            let start = Instant::now();
            if simulation.arguments.cells {
                let (found, of_cells) = solver.simulate_cells(batch)?;
                solutions.extend(found);
                cells.extend(of_cells);
            } else {
                let mut found = solver.simulate(batch)?;
                if let Some(errors) = &errors {
                    errors.add_to(&mut found, batch, &simulation.drawings[solutions.len()..])?;
                }
                solutions.extend(found);
            }
            seconds.extend(seconds_each(start, batch.len()));
            simulation.job.bar.advance(batch.len() as u64);
        }
        let (near_limit, screened) = match simulation.arguments.no_checks {
            true => (
                vec![None; patterns.len()],
                screened(&scene, patterns, &solutions, (&[], parameters))?,
            ),
            false => {
                let tests = TestPattern::some_of(patterns, NAME);
                (
                    near_limit(&scene, patterns, &solutions, parameters)?,
                    screened(&scene, patterns, &solutions, (&tests, parameters))?,
                )
            }
        };
        Ok(Self {
            state,
            screened,
            solver,
            solutions,
            seconds,
            cells,
            near_limit,
        })
    }

    fn warnings(&self) -> impl Iterator<Item = String> {
        let state = self.state.as_ref().map(|state| format!("in state {state}: "));
        let state = state.unwrap_or_default();
        let warnings = self.screened.warnings.iter();
        warnings.map(move |warning| format!("{state}{warning}"))
    }
}

/// All patterns, each in all states.
fn samples<'a>(
    simulation: &Simulation<'_>,
    runs: &'a [StateRun],
) -> impl Iterator<Item = (usize, &'a StateRun)> + use<'a> {
    (0..simulation.patterns.len()).flat_map(|index| runs.iter().map(move |run| (index, run)))
}

fn results(
    simulation: &Simulation<'_>,
    runs: &[StateRun],
    parameters: &SolverParameters,
    probe: Option<Probe>,
) -> Vec<SampleResult> {
    let cell_mm = simulation.scene.membrane().cell_mm();
    let accuracy_mm = parameters.accuracy().map(|accuracy| accuracy.value());
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
            breakdown_ratio: solution.observation.breakdown_ratio.filter(|_| is_observed),
            critical: is_searched.then_some(CriticalBracket {
                mesh: *mesh,
                on,
                between: solution.observation.critical_voltage,
            }),
        }
    };
    samples(simulation, runs).map(result).collect()
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

/// The arrays of all patterns, each in all states.
fn content(simulation: &Simulation<'_>, runs: &[StateRun], probe: Option<Probe>, warnings: &[String]) -> SolveFile {
    let samples = || samples(simulation, runs);
    let solutions: Vec<&AccurateSimulation> = samples().map(|(index, run)| &run.solutions[index]).collect();
    let fields = || solutions.iter().map(|solution| solution.simulation.field.as_ref());
    let (screened, solver) = (&runs[0].screened, &runs[0].solver);
    let observed: Vec<_> = solutions
        .iter()
        .map(|solution| Some(&solution.simulation.observation))
        .collect();
    let mut observations = Observations::of(&solver.observed(&screened.scene.effects), &screened.scene, &observed);
    let cells: Vec<&cells::States> = samples().filter_map(|(index, run)| run.cells.get(index)).collect();
    let with_cells = !cells.is_empty();
    if with_cells {
        let fraction = |states: &&cells::States| states.as_deref().map_or(f64::NAN, wrinkled_fraction);
        observations.wrinkled_fraction = Some(cells.iter().map(fraction).collect());
    }
    let (at_point, point) = probe
        .map(|probe| probe.of_all(fields().map(|field| field.map(|field| probe.of(field)))))
        .unzip();
    let scene = &simulation.scene;
    let row = 2 * scene.membrane().raster.corners();
    let mut displacement = Vec::with_capacity(solutions.len() * row);
    for field in fields() {
        match field {
            Some(field) => displacement.extend_from_slice(field.values()),
            None => displacement.extend(std::iter::repeat_n(f64::NAN, row)),
        }
    }
    let patterns: Vec<Pattern> = samples().map(|(index, _)| simulation.patterns[index].clone()).collect();
    SolveFile {
        electrodes: DrawnElectrodes::of(&patterns),
        covered: CoveredCells::of(&patterns),
        patterns,
        displacement: Packed(displacement),
        outcome: solutions
            .iter()
            .map(|solution| solution.simulation.outcome.kind())
            .collect(),
        max_displacement: fields()
            .map(|field| field.map_or(f64::NAN, Field::max_magnitude))
            .collect(),
        residual: Some(solutions.iter().map(|solution| solution.simulation.residual).collect()),
        solve_seconds: samples().map(|(index, run)| run.seconds[index]).collect(),
        at_point,
        point,
        observations,
        meshes: solver
            .estimates_errors()
            .then(|| solution::meshes(solutions.iter().copied())),
        cells: with_cells.then(|| cells::fields(&cells, scene.membrane().raster)),
        scene: scene.with_effects(screened.scene.effects.clone()).to_text(),
        solver: Some(simulation.solver()),
        effects: Some(screened.scene.effects.clone()),
        warnings: Some(Lines(warnings.to_vec())),
        ..SolveFile::default()
    }
}

/// Screens a scene for effects that the solutions neglect; without tests by the scene and these solutions alone.
fn screened(
    scene: &Scene,
    patterns: &[Pattern],
    solutions: &[AccurateSimulation],
    (tests, parameters): (&[TestPattern], &SolverParameters),
) -> Result<ScreenedScene, SetupError> {
    let limit = parameters.work_limit();
    // An estimate has no outcome that tells the stability.
    if parameters.method() != Method::Newton {
        return ScreenedScene::for_patterns(scene, tests, limit);
    }
    let solved = patterns.iter().zip(solutions).enumerate();
    let solved: Vec<Examined> = solved
        .map(|(at, (pattern, solution))| examined(&format!("{NAME} {at}"), scene, pattern, &solution.simulation))
        .collect();
    ScreenedScene::for_solutions(scene, tests, &solved, limit)
}

/// Finds the stable solutions that a finer mesh could reject, with their critical voltages.
fn near_limit(
    scene: &Scene,
    patterns: &[Pattern],
    solutions: &[AccurateSimulation],
    parameters: &SolverParameters,
) -> Result<Vec<Option<Option<CriticalVoltage>>>, CliError> {
    let none = vec![None; patterns.len()];
    let mesh = match (parameters.method(), parameters.mesh_request()) {
        (Method::Newton, MeshRequest::Fixed(mesh)) => mesh,
        // A requested accuracy compares meshes of up to four elements along a cell.
        (Method::Newton, MeshRequest::Accuracy(_)) => Mesh::biquadratic(2),
        // An estimate is not an equilibrium.
        _ => return Ok(none),
    };
    let tolerance = parameters.tolerance();
    let options = SolveOptions { mesh, tolerance };
    let searches = PatternSolver::new(scene, |scene| CriticalSearch::if_in_question(scene, options))?;
    if searches.usual().is_none() {
        return Ok(none);
    }
    let is_far_where_taut = scene.effects.wrinkling.is_some() && CriticalSearch::is_far_from_any_taut(scene)?;
    let is_in_question = |AccurateSimulation { simulation, .. }: &AccurateSimulation| {
        let is_taut = simulation.observation.wrinkled_fraction() == Some(0.0);
        simulation.field.is_some() && !(is_far_where_taut && is_taut)
    };
    let solved = patterns.par_iter().zip(solutions);
    let doubt = |(pattern, solution): (&Pattern, _)| {
        if !is_in_question(solution) {
            return Ok(None);
        }
        Ok(searches.with(pattern, |search| search.as_ref()?.uncertain_limit(pattern))?)
    };
    solved.map(doubt).collect()
}
