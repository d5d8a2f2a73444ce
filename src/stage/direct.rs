//! `solve` and `predict` without a pipeline: patterns that somebody drew, straight into one file.

use std::path::Path;
use std::time::Instant;

use super::cells::{self, States};
use super::screening::Screened;
use super::solution;
use crate::base::{Document, InputError, Progress};
use crate::content::{Lines, Observations, Packed, SolveFile, named_patterns};
use crate::fem::{AccurateSimulation, SetupError, SolverParameters, wrinkled_fraction};
use crate::field::{CORNERS, Field, PredictError, Predictor};
use crate::orchestrator::splice_scene;
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::store::Object;
use crate::surrogate::Surrogate;

/// Patterns that one thread solves between two reports of progress.
const BATCH: usize = 8;

/// What goes into the file, and how many samples have no stable solution.
#[derive(Debug)]
pub struct Answer {
    /// The arrays. Unlike an artifact it may hold NaN: in the rows of unstable samples.
    pub content: Object,
    /// Number of patterns.
    pub samples: usize,
    /// The outcome of each pattern without a stable solution: position and words.
    pub unstable: Vec<(usize, String)>,
    /// Patterns whose estimated error in mm is larger than the accuracy that was asked for, although the finest mesh was
    /// used: position and estimate.
    pub missed: Vec<(usize, f64)>,
    /// Effects that are called for and were not simulated, a line for each.
    pub warnings: Vec<String>,
    /// Patterns of which cells would wrinkle, where that was asked for: position and part of the membrane.
    pub wrinkled: Vec<(usize, f64)>,
}

/// Why there is no answer.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum DirectError {
    /// A scene or pattern that cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Input(#[from] InputError),
    /// A model that cannot be used.
    #[error("cannot use the model: {0}")]
    Model(String),
    /// The numerical work failed.
    #[error("{0}")]
    Failed(String),
}

impl From<PredictError> for DirectError {
    fn from(error: PredictError) -> Self {
        Self::Failed(error.to_string())
    }
}

/// All patterns that the arguments name, in order.
///
/// # Errors
/// When one cannot be read.
pub fn patterns(arguments: &[String]) -> Result<Vec<Pattern>, InputError> {
    let mut all = Vec::new();
    for argument in arguments {
        all.extend(named_patterns(argument)?);
    }
    Ok(all)
}

/// Simulates patterns in a scene read from `scene`, a scene or a pipeline whose scene is used; with the state of every cell
/// where that is wanted.
///
/// # Errors
/// When the scene cannot be read or the solver cannot be set up.
pub fn solve(
    scene: &Path,
    patterns: &[Pattern],
    parameters: &SolverParameters,
    with_cells: bool,
    progress: &dyn Progress,
) -> Result<Answer, DirectError> {
    let failed = |e: SetupError| DirectError::Failed(e.to_string());
    let scene = read_scene(scene)?;
    let screened = Screened::new(&scene).map_err(failed)?;
    let scene = &screened.scene;
    let solver = parameters.build(scene).map_err(failed)?;
    let threads = rayon::current_num_threads();
    let mut results = Vec::with_capacity(patterns.len());
    let mut seconds = Vec::with_capacity(patterns.len());
    let mut states: Vec<States> = Vec::new();
    for batch in patterns.chunks(BATCH * threads) {
        let start = Instant::now();
        if with_cells {
            let (found, cells) = solver.simulate_cells(batch).map_err(failed)?;
            results.extend(found);
            states.extend(cells);
        } else {
            results.extend(solver.simulate(batch).map_err(failed)?);
        }
        seconds.extend(seconds_each(start, batch.len(), threads));
        progress.advance(batch.len() as u64);
    }
    let observed: Vec<_> = results.iter().map(|r| Some(&r.simulation.observation)).collect();
    let mut observations = Observations::of(&solver.observed(&scene.effects), &observed);
    if with_cells {
        let fraction = |states: &States| states.as_deref().map_or(f64::NAN, wrinkled_fraction);
        observations.wrinkled_fraction = Some(states.iter().map(fraction).collect());
    }
    let content = SolveFile {
        observations,
        meshes: solver.estimates_errors().then(|| solution::meshes(results.iter())),
        cells: with_cells.then(|| cells::fields(&states)),
        scene: scene.to_text(),
        solver: Some(format!("{{ {} }}", parameters)),
        effects: Some(screened.effects()),
        warnings: Some(Lines(screened.warnings.clone())),
        ..simulated(patterns, &results, seconds)
    };
    let wrinkled = states.iter().enumerate();
    let wrinkled = wrinkled.filter_map(|(i, states)| Some((i, wrinkled_fraction(states.as_deref()?))));
    let unstable = results.iter().enumerate().filter(|(_, r)| r.simulation.field.is_none());
    let unstable = unstable.map(|(i, r)| (i, r.simulation.outcome.to_string())).collect();
    let wanted = parameters.accuracy().map_or(f64::INFINITY, |accuracy| accuracy.value());
    let estimates = results
        .iter()
        .enumerate()
        .filter_map(|(i, r)| Some((i, r.discretisation_error?)));
    let missed = estimates.filter(|(_, error)| *error > wanted).collect();
    Ok(Answer {
        content: content.object(),
        samples: patterns.len(),
        unstable,
        missed,
        warnings: screened.warnings,
        wrinkled: wrinkled.filter(|(_, fraction)| *fraction > 0.0).collect(),
    })
}

/// The time since `start`, shared out evenly; threads beyond the number of samples stood idle.
fn seconds_each(start: Instant, samples: usize, threads: usize) -> impl Iterator<Item = f64> {
    let each = start.elapsed().as_secs_f64() * threads.min(samples) as f64 / samples as f64;
    std::iter::repeat_n(each, samples)
}

/// The scene in a file: a scene, or a pipeline whose scene is meant.
///
/// # Errors
/// When it cannot be read.
pub fn read_scene(path: &Path) -> Result<Scene, InputError> {
    let mut root = Document::load(path)?.root;
    splice_scene(&mut root, path)?;
    super::checked_scene(root.peek("scene").unwrap_or(&root))
}

/// Rows without a stable solution are NaN here and nowhere else; their outcome says why.
fn simulated(patterns: &[Pattern], results: &[AccurateSimulation], seconds: Vec<f64>) -> SolveFile {
    let row = CORNERS * CORNERS * 2;
    let mut displacement = Vec::with_capacity(patterns.len() * row);
    for result in results {
        match &result.simulation.field {
            Some(field) => displacement.extend_from_slice(field.values()),
            None => displacement.extend(std::iter::repeat_n(f64::NAN, row)),
        }
    }
    let largest = |r: &AccurateSimulation| r.simulation.field.as_ref().map_or(f64::NAN, Field::max_magnitude);
    let outcome = |r: &AccurateSimulation| r.simulation.outcome.name().to_owned();
    SolveFile {
        patterns: patterns.to_vec(),
        displacement: Packed(displacement),
        outcome: results.iter().map(outcome).collect(),
        max_displacement: results.iter().map(largest).collect(),
        residual: Some(results.iter().map(|r| r.simulation.residual).collect()),
        solve_seconds: seconds,
        ..SolveFile::default()
    }
}

/// Predicts patterns with a model given as the bytes of a safetensors file, which must be one for the scene if that is given.
///
/// # Errors
/// When the bytes are no model or one for another scene, or it cannot be evaluated.
pub fn predict(
    weights: &[u8],
    patterns: &[Pattern],
    scene: Option<&Scene>,
    progress: &dyn Progress,
) -> Result<Answer, DirectError> {
    let surrogate = Surrogate::load(weights).map_err(|e| DirectError::Model(e.to_string()))?;
    if let Some(scene) = scene {
        surrogate
            .check_scene(scene)
            .map_err(|e| DirectError::Model(e.to_string()))?;
    }
    let threads = rayon::current_num_threads();
    let (mut fields, mut seconds) = (Vec::with_capacity(patterns.len()), Vec::with_capacity(patterns.len()));
    for batch in patterns.chunks(256) {
        let start = Instant::now();
        fields.extend(surrogate.predict(batch)?);
        seconds.extend(seconds_each(start, batch.len(), threads));
        progress.advance(batch.len() as u64);
    }
    let content = SolveFile {
        patterns: patterns.to_vec(),
        outcome: vec!["predicted".to_owned(); patterns.len()],
        max_displacement: fields.iter().map(Field::max_magnitude).collect(),
        displacement: Packed(fields.iter().flat_map(Field::values).copied().collect()),
        solve_seconds: seconds,
        scene: surrogate.scene().unwrap_or_default().to_owned(),
        network: Some(surrogate.kind().name().to_owned()),
        ..SolveFile::default()
    };
    Ok(Answer {
        content: content.object(),
        samples: patterns.len(),
        unstable: Vec::new(),
        missed: Vec::new(),
        warnings: Vec::new(),
        wrinkled: Vec::new(),
    })
}
