//! Simulates patterns that somebody drew, straight into one file.

use std::time::Instant;

use rayon::prelude::*;
use serde_json::Value;

use super::cells::{self, States};
use super::error::CliError;
use crate::base::Progress;
use crate::content::{Lines, Observations, Packed, SolveFile};
use crate::fem::screening::Screened;
use crate::fem::{
    AccurateSimulation, CriticalSearch, CriticalVoltage, MeshRequest, Method, SolveOptions, SolverParameters,
    wrinkled_fraction,
};
use crate::field::Field;
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::stage::solution;
use crate::store::Object;

/// Patterns that one thread solves between two reports of progress.
const BATCH: usize = 8;

/// What goes into the file, and how many samples have no stable solution.
#[derive(Debug, Default)]
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
    /// Patterns that are so close to their critical voltage that a finer mesh could find them beyond it: position and, where it was
    /// found, that voltage.
    pub near_limit: Vec<(usize, Option<CriticalVoltage>)>,
    /// Patterns of which cells would wrinkle, where that was asked for: position and part of the membrane.
    pub wrinkled: Vec<(usize, f64)>,
    /// What else is said.
    pub statement: Statement,
}

/// What a command says besides, for people and for programs.
#[derive(Debug, Default)]
pub struct Statement {
    /// The key in the document; none is written where it is empty.
    pub key: &'static str,
    /// What stands there.
    pub document: Option<Value>,
    /// The same in words.
    pub lines: Vec<String>,
}

/// Simulates patterns in a scene; with the state of every cell where that is wanted.
///
/// # Errors
/// When the solver cannot be set up.
pub fn solve(
    scene: &Scene,
    patterns: &[Pattern],
    parameters: &SolverParameters,
    with_cells: bool,
    progress: &dyn Progress,
) -> Result<Answer, CliError> {
    let screened = Screened::for_patterns(scene, patterns, parameters.work_limit())?;
    let scene = &screened.scene;
    let solver = parameters.build(scene)?;
    let threads = rayon::current_num_threads();
    let mut results = Vec::with_capacity(patterns.len());
    let mut seconds = Vec::with_capacity(patterns.len());
    let mut states: Vec<States> = Vec::new();
    for batch in patterns.chunks(BATCH * threads) {
        let start = Instant::now();
        if with_cells {
            let (found, cells) = solver.simulate_cells(batch)?;
            results.extend(found);
            states.extend(cells);
        } else {
            results.extend(solver.simulate(batch)?);
        }
        seconds.extend(seconds_each(start, batch.len(), threads));
        progress.advance(batch.len() as u64);
    }
    let near_limit = near_limit(scene, patterns, &results, parameters)?;
    let observed: Vec<_> = results.iter().map(|r| Some(&r.simulation.observation)).collect();
    let mut observations = Observations::of(&solver.observed(&scene.effects), scene, &observed);
    if with_cells {
        let fraction = |states: &States| states.as_deref().map_or(f64::NAN, wrinkled_fraction);
        observations.wrinkled_fraction = Some(states.iter().map(fraction).collect());
    }
    let content = SolveFile {
        observations,
        meshes: solver.estimates_errors().then(|| solution::meshes(results.iter())),
        cells: with_cells.then(|| cells::fields(&states, scene.membrane().raster)),
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
        near_limit,
        wrinkled: wrinkled.filter(|(_, fraction)| *fraction > 0.0).collect(),
        statement: Statement::default(),
    })
}

/// The stable solutions that a finer mesh could refuse. An estimate is no equilibrium, and `--accuracy` asks finer meshes itself.
fn near_limit(
    scene: &Scene,
    patterns: &[Pattern],
    results: &[AccurateSimulation],
    parameters: &SolverParameters,
) -> Result<Vec<(usize, Option<CriticalVoltage>)>, CliError> {
    let (Method::Newton, MeshRequest::Fixed(mesh)) = (parameters.method(), parameters.mesh_request()) else {
        return Ok(Vec::new());
    };
    if CriticalSearch::is_far_from_any(scene)? {
        return Ok(Vec::new());
    }
    let tolerance = parameters.tolerance();
    let search = CriticalSearch::beside(scene, SolveOptions { mesh, tolerance })?;
    let solved = patterns.par_iter().zip(results).enumerate();
    let doubtful = solved.filter(|(_, (pattern, result))| result.simulation.field.is_some() && !search.keeps(pattern));
    let near = doubtful.map(|(at, (pattern, _))| (at, search.near(pattern, scene.voltage_v())));
    Ok(near.collect())
}

/// The time since `start`, shared out evenly; threads beyond the number of samples stood idle.
pub fn seconds_each(start: Instant, samples: usize, threads: usize) -> impl Iterator<Item = f64> {
    let each = start.elapsed().as_secs_f64() * threads.min(samples) as f64 / samples as f64;
    std::iter::repeat_n(each, samples)
}

/// Rows without a stable solution are NaN here and nowhere else; their outcome says why.
fn simulated(patterns: &[Pattern], results: &[AccurateSimulation], seconds: Vec<f64>) -> SolveFile {
    let row = patterns.first().map_or(0, |pattern| 2 * pattern.raster().corners());
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
