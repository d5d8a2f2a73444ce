//! The genetic algorithm: designs improve by selection among many, judged by a fast predictor.
//!
//! The procedure of the source paper (Qin et al., doi 10.1089/soro.2024.0063, "GA-based inverse design"): 1000 random
//! individuals of 20 × 20 units; predict, sort; the best 2 % go on unchanged, the rest is recombined by two-point
//! crossover (p 0.7), mutated by inversion (p 0.3) and filtered; 60 iterations. What the paper leaves open: parents win a
//! tournament of two by rank, and the search may end early after a number of generations without gain.
//!
//! Beside the paper's procedure stand what it does not have: a first generation of several areas where the area is free;
//! constraints, to which each individual's pattern is mended, with a penalty for what cannot be mended; margins, of which only
//! the best are asked; niches, so that several different designs are found at once; and a rough score by which all are ranked, so that
//! only the best are judged. None of it changes a search without it.
//!
//! Every random choice of a generation is a function of the seed and the generation's number, and equal fitness is
//! ordered by genome, so a search can be gone on with from any generation and does not depend on threads.

mod history;
mod niche;
mod options;
mod result;
mod search;
mod state;

pub use options::{EvolveOptions, OptionsError};
pub use result::{Evolution, GenerationReport, Stop, Watch, Winner};
pub use state::StateError;

use super::constraint::Constraints;
use super::genome::{Genome, UNITS, unit_of};
use super::objective::{Goal, RoughScore};
use deaflow_base::{Stopped, Stream};
use deaflow_field::{Feasibility, PredictError, Predictor, StateFields};
use history::{History, Individual};
use search::Search;
use state::State;

/// The coarsest grain of the first generation, drawn with the finer ones in equal shares. The paper's first generation is
/// random, not saying how; at an area far from one half single random units would all fall to the filter at once.
const COARSEST: usize = 4;

/// Between these the areas of the first generation lie where the area is free.
const FREE_AREAS: [f64; 2] = [0.05, 0.95];

/// What is searched for, and by what it is judged.
#[derive(Clone, Copy)]
pub struct Setting<'a> {
    /// Predicts the fields of a pattern in the states of the device.
    pub predictor: &'a dyn Predictor<StateFields>,
    /// What is wanted.
    pub goal: &'a Goal,
    /// What patterns must keep to.
    pub constraints: &'a Constraints,
    /// What the best must keep to beside, if anything.
    pub feasibility: Option<&'a dyn Feasibility>,
    /// What ranks patterns in microseconds, so that only the best of a generation are judged.
    pub rough: Option<&'a RoughScore<'a>>,
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum EvolveError {
    /// The options describe no search.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// The predictor, or what says whether a pattern is feasible, failed.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// There is nothing to choose from.
    #[error("no pattern of the first generation has a field: there is nothing to choose from")]
    NoField,
    /// It was asked to stop.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// There is nothing to choose from.
    #[error("no pattern of the first generation keeps the margins: there is nothing to choose from")]
    NotFeasible,
}

/// Random genomes with the nearest number of units to `area` · 400 on, from the finest grain to a coarse one, and over areas
/// from 5 % to 95 % where the area is free: the first generation of a search under a seed, or its beginning. Units of which the
/// constraints allow no cell are off.
#[must_use]
pub fn first_generation(area: Option<f64>, constraints: &Constraints, seed: u64, population: usize) -> Vec<Genome> {
    let allowed = allowed_units(constraints);
    let random = |index| {
        let mut stream = Stream::new(seed, "first generation", index);
        let grain = stream.index(COARSEST + 1);
        let area = area.unwrap_or_else(|| stream.range(FREE_AREAS[0], FREE_AREAS[1]));
        Genome::random_within(&allowed, area, constraints.groups(), grain, &mut stream)
    };
    (0..population as u64).map(random).collect()
}

/// The units with at least one cell that the constraints allow.
fn allowed_units(constraints: &Constraints) -> Genome {
    let raster = constraints.membrane().raster;
    let mut units = [false; UNITS * UNITS];
    for (cell, _) in constraints
        .allowed()
        .iter()
        .enumerate()
        .filter(|(_, allowed)| **allowed)
    {
        let [x, y] = unit_of(raster, [cell % raster.columns(), cell / raster.columns()]);
        units[y * UNITS + x] = true;
    }
    Genome::from_fn(|x, y| units[y * UNITS + x])
}

/// Searches for the patterns of the least F. `watch` hears of every generation once it is judged, and may keep the state of the
/// search: from a state that was kept it goes on to the same result, to the last bit. A pattern of which the predictor has no
/// field is worse than any other; so is one that is not feasible, which is asked of the best of a generation only.
///
/// # Errors
/// When the options are out of range, the predictor fails, or there is nothing to choose from in the first generation.
pub fn evolve(setting: &Setting<'_>, options: &EvolveOptions, watch: &dyn Watch) -> Result<Evolution, EvolveError> {
    options.validate()?;
    let mut search = Search::new(setting, options);
    let mut history = match resume(&mut search, options, watch) {
        Some(history) => history,
        None => start(&mut search, setting, options, watch)?,
    };
    let stop = loop {
        if let Some(stop) = history.end(options) {
            break stop;
        }
        let population = search.evaluated(search.next_generation(&history), watch)?;
        record(&mut history, population, &search, watch)?;
    };
    let winners = search.winners(&history)?;
    Ok(Evolution {
        history: history.reports,
        stop,
        winners,
        evaluations: search.evaluations(),
    })
}

/// What a search had come to when its state was kept, if it was.
fn resume(search: &mut Search<'_>, options: &EvolveOptions, watch: &dyn Watch) -> Option<History> {
    let bytes = watch.kept()?;
    match State::from_bytes(&bytes, options, search.groups()) {
        Ok(state) => {
            let history = search.restored(state);
            if let Some(last) = history.reports.last() {
                watch.resumed(last);
            }
            Some(history)
        }
        Err(error) => {
            watch.unusable(&error);
            None
        }
    }
}

/// The first generation.
fn start(
    search: &mut Search<'_>,
    setting: &Setting<'_>,
    options: &EvolveOptions,
    watch: &dyn Watch,
) -> Result<History, EvolveError> {
    let genomes = first_generation(
        setting.goal.area(),
        setting.constraints,
        options.seed,
        options.population,
    );
    let population = search.evaluated(genomes, watch)?;
    if population[0].known.fitness.is_infinite() {
        return Err(match population.iter().any(|i| i.known.feasible == Some(false)) {
            true => EvolveError::NotFeasible,
            false => EvolveError::NoField,
        });
    }
    let mut history = History::default();
    record(&mut history, population, search, watch)?;
    Ok(history)
}

/// Adds a generation to the history and reports it.
fn record(
    history: &mut History,
    population: Vec<Individual>,
    search: &Search<'_>,
    watch: &dyn Watch,
) -> Result<(), Stopped> {
    history.add(population);
    if let Some(report) = history.reports.last() {
        watch.generation(report);
    }
    watch.keep(&|| search.state(history))
}

#[cfg(test)]
mod tests;
