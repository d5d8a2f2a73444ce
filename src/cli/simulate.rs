//! Simulates patterns that somebody drew, straight into one file.

use std::fmt;
use std::time::Instant;

use rayon::prelude::*;
use serde_json::{Value, json};

use super::cells::{self, States};
use super::error::CliError;
use super::outcomes::{Ending, Peak, Reached};
use super::point::Watched;
use super::text::Text;
use deaflow_base::Progress;
use deaflow_content::{Lines, Observations, Packed, SolveFile};
use deaflow_fem::screening::{NOT_EACH, Screened, resolve_states};
use deaflow_fem::{
    AccurateSimulation, CriticalSearch, CriticalVoltage, MeshRequest, Method, SolveOptions, Solver, SolverParameters,
    wrinkled_fraction,
};
use deaflow_field::{Field, Mesh, Order};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_stage::solution;
use deaflow_store::Object;

/// Patterns that one thread solves between two reports of progress.
const BATCH: usize = 8;

/// A pattern in one of the states of its scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Position of the pattern.
    pub index: usize,
    /// The state; none where the scene has no states.
    pub state: Option<String>,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "pattern {}", self.index)?;
        self.state
            .as_ref()
            .map_or(Ok(()), |state| write!(f, " in state {state}"))
    }
}

impl Place {
    /// Its keys in a document, with others.
    pub fn document(&self, others: Value) -> Value {
        let mut document = json!({ "index": self.index });
        if let Some(state) = &self.state {
            document["state"] = json!(state);
        }
        if let (Value::Object(document), Value::Object(others)) = (&mut document, others) {
            document.extend(others);
        }
        document
    }
}

/// What goes into the file, and how many samples have no stable solution.
#[derive(Debug, Default)]
pub struct Answer {
    /// The arrays. Unlike an artifact it may hold NaN: in the rows of unstable samples.
    pub content: Object,
    /// Number of patterns.
    pub samples: usize,
    /// The point whose displacement is told too.
    pub watched: Option<Watched>,
    /// How each pattern ended.
    pub endings: Vec<Ending>,
    /// The outcome of each pattern without a stable solution: position and words.
    pub unstable: Vec<(Place, String)>,
    /// Patterns whose estimated error in mm is larger than the accuracy that was asked for, although the finest mesh was
    /// used: position and estimate.
    pub missed: Vec<(Place, f64)>,
    /// Effects that are called for and were not simulated, a line for each.
    pub warnings: Vec<String>,
    /// Patterns that are so close to their critical voltage that a finer mesh could find them beyond it: position and, where it was
    /// found, that voltage.
    pub near_limit: Vec<(Place, Option<CriticalVoltage>)>,
    /// Patterns of which cells would wrinkle, where that was asked for: position and part of the membrane.
    pub wrinkled: Vec<(Place, f64)>,
    /// Where patterns lose stability, of those that the effect `electromechanical_stability` has this computed for.
    pub critical: Vec<Critical>,
    /// Whether voltages at which stability is lost are those of bilinear elements, which lose it too late.
    pub is_late: bool,
    /// What else is said.
    pub statement: Statement,
}

/// Where a pattern loses stability.
#[derive(Clone, Debug)]
pub struct Critical {
    /// The pattern.
    pub place: Place,
    /// The mesh on which it does.
    pub mesh: Mesh,
    /// That mesh in words, behind a comma; empty where all patterns have it.
    pub on: String,
    /// The voltages between which it does, in V, where these were found.
    pub between: Option<[f64; 2]>,
    /// Whether it has no stable state, so that how it ended says the same.
    pub is_lost: bool,
}

/// What a command says besides, for people and for programs.
#[derive(Debug, Default)]
pub struct Statement {
    /// The key in the document; none is written where it is empty.
    pub key: &'static str,
    /// What stands there.
    pub document: Option<Value>,
    /// The same in words.
    pub text: Text,
    /// Whether the words tell of each pattern how far it moves.
    pub tells_each: bool,
}

/// Simulates patterns in a scene, in each of its states where it has such; with the state of every cell and the displacement of a point
/// where these are wanted.
///
/// # Errors
/// When the solver cannot be set up.
pub fn solve(
    scene: &Scene,
    patterns: &[Pattern],
    parameters: &SolverParameters,
    (with_cells, watched): (bool, Option<Watched>),
    progress: &dyn Progress,
) -> Result<Answer, CliError> {
    let mut runs = Vec::new();
    let decided = resolve_states(scene)?;
    for (name, scene) in decided.in_states() {
        let state = (!name.is_empty()).then(|| name.to_owned());
        runs.push(Run::new(state, &scene, patterns, parameters, with_cells, progress)?);
    }
    Ok(answer(scene, patterns, (parameters, watched), &runs))
}

/// What the patterns do in one state.
struct Run {
    state: Option<String>,
    screened: Screened,
    solver: Solver,
    results: Vec<AccurateSimulation>,
    seconds: Vec<f64>,
    cells: Vec<States>,
    near_limit: Vec<(usize, Option<CriticalVoltage>)>,
}

impl Run {
    fn new(
        state: Option<String>,
        scene: &Scene,
        patterns: &[Pattern],
        parameters: &SolverParameters,
        with_cells: bool,
        progress: &dyn Progress,
    ) -> Result<Self, CliError> {
        let screened = Screened::for_patterns(scene, patterns, parameters.work_limit())?;
        let solver = parameters.build(&screened.scene)?;
        let threads = rayon::current_num_threads();
        let mut results = Vec::with_capacity(patterns.len());
        let mut seconds = Vec::with_capacity(patterns.len());
        let mut cells: Vec<States> = Vec::new();
        // A few come first, so that there is a pace soon where each takes long.
        let (first, rest) = patterns.split_at(threads.min(patterns.len()));
        for batch in std::iter::once(first).chain(rest.chunks(BATCH * threads)) {
            let start = Instant::now();
            if with_cells {
                let (found, of_cells) = solver.simulate_cells(batch)?;
                results.extend(found);
                cells.extend(of_cells);
            } else {
                results.extend(solver.simulate(batch)?);
            }
            seconds.extend(seconds_each(start, batch.len(), threads));
            progress.advance(batch.len() as u64);
        }
        let near_limit = near_limit(&screened.scene, patterns, &results, parameters)?;
        Ok(Self {
            state,
            screened,
            solver,
            results,
            seconds,
            cells,
            near_limit,
        })
    }

    fn place(&self, index: usize) -> Place {
        Place {
            index,
            state: self.state.clone(),
        }
    }

    fn warnings(&self) -> impl Iterator<Item = String> {
        let state = self.state.as_ref().map(|state| format!("in state {state}: "));
        let state = state.unwrap_or_default();
        // It is judged by the pattern that loses it first, which need not be like any of these.
        let each = |warning: &str| match warning.contains(NOT_EACH) && warning.contains('`') {
            true => "; `--set effects.electromechanical_stability=true` tells of these patterns one by one",
            false => "",
        };
        self.screened
            .warnings
            .iter()
            .map(move |warning| format!("{state}{warning}{}", each(warning)))
    }
}

/// The rows of all patterns, each in all states.
fn answer(
    scene: &Scene,
    patterns: &[Pattern],
    (parameters, watched): (&SolverParameters, Option<Watched>),
    runs: &[Run],
) -> Answer {
    let rows = || (0..patterns.len()).flat_map(|index| runs.iter().map(move |run| (index, run)));
    let results: Vec<&AccurateSimulation> = rows().map(|(index, run)| &run.results[index]).collect();
    let seconds: Vec<f64> = rows().map(|(index, run)| run.seconds[index]).collect();
    let (screened, solver) = (&runs[0].screened, &runs[0].solver);
    let observed: Vec<_> = results.iter().map(|r| Some(&r.simulation.observation)).collect();
    let mut observations = Observations::of(&solver.observed(&screened.scene.effects), &screened.scene, &observed);
    let cells: Vec<&States> = rows().filter_map(|(index, run)| run.cells.get(index)).collect();
    let with_cells = !cells.is_empty();
    if with_cells {
        let fraction = |states: &&States| states.as_deref().map_or(f64::NAN, wrinkled_fraction);
        observations.wrinkled_fraction = Some(cells.iter().map(fraction).collect());
    }
    let warnings: Vec<String> = runs.iter().flat_map(Run::warnings).collect();
    let (at_point, point) = watched
        .map(|watched| {
            let fields = results.iter().map(|result| result.simulation.field.as_ref());
            watched.of_all(fields.map(|field| field.map(|field| watched.of(field))))
        })
        .unzip();
    let content = SolveFile {
        at_point,
        point,
        observations,
        meshes: solver
            .estimates_errors()
            .then(|| solution::meshes(results.iter().copied())),
        cells: with_cells.then(|| cells::fields(&cells, scene.membrane().raster)),
        scene: scene.with_effects(screened.scene.effects.clone()).to_text(),
        solver: Some(format!("{{ {} }}", parameters)),
        effects: Some(screened.effects()),
        warnings: Some(Lines(warnings.clone())),
        ..simulated(
            rows().map(|(index, _)| patterns[index].clone()).collect(),
            &results,
            seconds,
        )
    };
    let wanted = parameters.accuracy().map_or(f64::INFINITY, |accuracy| accuracy.value());
    let cell_mm = scene.membrane().cell_mm();
    let endings = rows().map(|(index, run)| {
        let simulation = &run.results[index].simulation;
        Ending {
            place: run.place(index),
            outcome: simulation.outcome.name().to_owned(),
            peak: simulation.field.as_ref().map(|field| Peak::of(field, Some(cell_mm))),
            name: String::new(),
            along_mm: simulation.field.as_ref().and_then(|field| Some(watched?.of(field))),
            reached: parameters.accuracy().map(|_| Reached {
                mesh: run.results[index].mesh,
                error_mm: run.results[index].discretisation_error,
            }),
        }
    });
    let unstable = rows().filter(|(index, run)| run.results[*index].simulation.field.is_none());
    // Two meshes lose stability at two voltages, which would contradict each other.
    let on = |mesh: &Mesh| match parameters.accuracy() {
        Some(_) => format!(", on {mesh}"),
        None => String::new(),
    };
    let unstable = unstable.map(|(index, run)| {
        let AccurateSimulation { simulation, mesh, .. } = &run.results[index];
        (run.place(index), format!("{}{}", simulation.outcome, on(mesh)))
    });
    let missed = rows().filter_map(|(index, run)| Some((run.place(index), run.results[index].discretisation_error?)));
    let wrinkled = rows().filter_map(|(index, run)| {
        let states = run.cells.get(index)?.as_deref()?;
        Some((run.place(index), wrinkled_fraction(states)))
    });
    let states: Vec<String> = runs.iter().filter_map(|run| run.state.clone()).collect();
    let searched = rows().filter(|(_, run)| run.screened.scene.effects.electromechanical_stability.is_some());
    let critical = searched.map(|(index, run)| {
        let AccurateSimulation { simulation, mesh, .. } = &run.results[index];
        Critical {
            place: run.place(index),
            mesh: *mesh,
            on: on(mesh),
            between: simulation.observation.critical_voltage,
            is_lost: simulation.field.is_none(),
        }
    });
    let critical: Vec<_> = critical.collect();
    let is_bilinear = matches!(parameters.mesh_request(), MeshRequest::Fixed(mesh) if mesh.order() == Order::Bilinear);
    let is_lost = |result: &&AccurateSimulation| result.simulation.outcome.bracket().is_some();
    let is_late = is_bilinear && (results.iter().any(is_lost) || critical.iter().any(|found| found.between.is_some()));
    Answer {
        critical,
        is_late,
        content: content.in_states(&states),
        samples: patterns.len(),
        watched,
        endings: endings.collect(),
        unstable: unstable.collect(),
        missed: missed.filter(|(_, error)| *error > wanted).collect(),
        warnings,
        wrinkled: wrinkled.filter(|(_, fraction)| *fraction > 0.0).collect(),
        near_limit: runs
            .iter()
            .flat_map(|run| run.near_limit.iter().map(|(index, found)| (run.place(*index), *found)))
            .collect(),
        statement: Statement::default(),
    }
}

/// The stable solutions that a finer mesh could refuse. An estimate is no equilibrium; an accuracy asks finer meshes itself, up to four elements
/// along a cell, which these are compared with.
fn near_limit(
    scene: &Scene,
    patterns: &[Pattern],
    results: &[AccurateSimulation],
    parameters: &SolverParameters,
) -> Result<Vec<(usize, Option<CriticalVoltage>)>, CliError> {
    let mesh = match (parameters.method(), parameters.mesh_request()) {
        (Method::Newton, MeshRequest::Fixed(mesh)) => mesh,
        (Method::Newton, MeshRequest::Accuracy(_)) => Mesh::biquadratic(2),
        _ => return Ok(Vec::new()),
    };
    // A charge has no voltage to be lost at.
    if scene.drive.charge.is_some() || CriticalSearch::is_far_from_any(scene)? {
        return Ok(Vec::new());
    }
    let tolerance = parameters.tolerance();
    let search = CriticalSearch::beside(scene, SolveOptions { mesh, tolerance })?;
    let is_far_where_taut = scene.effects.wrinkling.is_some() && CriticalSearch::is_far_from_any_taut(scene)?;
    let is_in_question = |AccurateSimulation { simulation, .. }: &AccurateSimulation| {
        let is_taut = simulation.observation.wrinkled_fraction() == Some(0.0);
        simulation.field.is_some() && !(is_far_where_taut && is_taut)
    };
    let solved = patterns.par_iter().zip(results).enumerate();
    let questioned = solved.filter(|(_, (_, result))| is_in_question(result));
    let doubtful = questioned.filter_map(|(at, (pattern, _))| search.doubt(pattern).map(|found| (at, found)));
    Ok(doubtful.collect())
}

/// The time since `start`, shared out evenly; threads beyond the number of samples stood idle.
pub fn seconds_each(start: Instant, samples: usize, threads: usize) -> impl Iterator<Item = f64> {
    let each = start.elapsed().as_secs_f64() * threads.min(samples) as f64 / samples as f64;
    std::iter::repeat_n(each, samples)
}

/// Rows without a stable solution are NaN here and nowhere else; their outcome says why.
fn simulated(patterns: Vec<Pattern>, results: &[&AccurateSimulation], seconds: Vec<f64>) -> SolveFile {
    let row = patterns.first().map_or(0, |pattern| 2 * pattern.raster().corners());
    let mut displacement = Vec::with_capacity(results.len() * row);
    for result in results {
        match &result.simulation.field {
            Some(field) => displacement.extend_from_slice(field.values()),
            None => displacement.extend(std::iter::repeat_n(f64::NAN, row)),
        }
    }
    let largest = |r: &&AccurateSimulation| r.simulation.field.as_ref().map_or(f64::NAN, Field::max_magnitude);
    let outcome = |r: &&AccurateSimulation| r.simulation.outcome.name().to_owned();
    SolveFile {
        patterns,
        displacement: Packed(displacement),
        outcome: results.iter().map(outcome).collect(),
        max_displacement: results.iter().map(largest).collect(),
        residual: Some(results.iter().map(|r| r.simulation.residual).collect()),
        solve_seconds: seconds,
        ..SolveFile::default()
    }
}
