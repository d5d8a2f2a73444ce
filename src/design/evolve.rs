//! The genetic algorithm, with patterns judged by a fast predictor.
//!
//! The procedure of the source paper (Qin et al., doi 10.1089/soro.2024.0063, "GA-based inverse design"): 1000 random
//! individuals of 20 × 20 units; predict and sort; the best 2 % are kept, the others are replaced by two-point
//! crossover (p 0.7), inversion mutation (p 0.3) and a filter; 60 iterations. Not specified in the paper: parents are
//! selected by a tournament of two, and the search may end after a number of generations without improvement.
//!
//! Extensions, which do not change a search without them: a first generation with different areas if the area is free;
//! constraints, by repair of each pattern and a penalty for what cannot be repaired; margins, which are checked for
//! the best only; niches, for several different designs; and a rough score, so that only the best by this score are
//! judged.
//!
//! The random numbers of a generation depend on the seed and the number of the generation only, and individuals of
//! equal fitness are ordered by genome. So a search can be resumed from any generation and does not depend on threads.

mod breed;
mod checkpoint;
mod history;
mod niche;
mod nsga2;
mod nsga2_checkpoint;
mod options;
mod result;
mod resume;
mod search;
mod winners;

pub use checkpoint::CheckpointError;
pub use nsga2::{FrontEvolution, FrontGeneration, FrontMember, FrontProblem, evolve_front};
pub use options::{EvolveOptions, OptionsError};
pub use result::{Evolution, FrontReport, GenerationReport, Observer, Stop, Winner};

use super::constraint::Constraints;
use super::genome::{Genome, Units};
use super::objective::{Goal, RoughScore};
use checkpoint::Checkpoint;
use deaflow_base::{Stopped, Stream};
use deaflow_field::{Feasibility, PredictError, Predictor, StateFields};
use history::{History, Individual};
use search::Search;

/// The coarsest grain of the first generation; all grains up to it have equal shares. The paper does not specify its
/// random first generation. At an area far from one half, the filter would remove all single random units at once.
const COARSEST: usize = 4;

/// The range of areas in the first generation if the area is free.
const FREE_AREAS: [f64; 2] = [0.05, 0.95];

/// The goal of a search, and how patterns are judged.
#[derive(Clone, Copy)]
pub struct EvolveProblem<'a> {
    /// Predicts the fields of patterns in the states of the device.
    pub predictor: &'a dyn Predictor<StateFields>,
    /// The goal.
    pub goal: &'a Goal,
    /// The constraints on patterns.
    pub constraints: &'a Constraints,
    /// Checks the margins of the best patterns.
    pub feasibility: Option<&'a dyn Feasibility>,
    /// Ranks patterns in microseconds, so that only the best of a generation are judged.
    pub rough: Option<&'a RoughScore<'a>>,
}

/// Errors of a search.
#[derive(Debug, thiserror::Error)]
pub enum EvolveError {
    /// The options are invalid.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// The predictor or the feasibility check failed.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// No pattern has a field.
    #[error("no pattern of the first generation has a stable solution")]
    NoField,
    /// The search was stopped.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The front has no design.
    #[error("no pattern satisfies the constraints and gains anything over the membrane at rest")]
    NoDesign,
    /// No pattern is feasible.
    #[error("no pattern of the first generation satisfies the margins (`pull_in_margin`, `breakdown_margin`)")]
    NotFeasible,
}

/// The first individuals of the first generation of a search: random genomes of different grain with round(`area` ·
/// 400) units on, less in proportion to the cells that may not carry electrodes, or with areas from 5 % to 95 % if the
/// area is free. Units without an allowed cell are off.
#[must_use]
pub fn first_generation(area: Option<f64>, constraints: &Constraints, seed: u64, population: usize) -> Vec<Genome> {
    let areas = area.map_or(FREE_AREAS, |area| [area; 2]);
    generation_within(areas, constraints, seed, population)
}

/// The first generation of a goal. Up to a largest area, areas are those of a free area up to it.
pub(crate) fn first_generation_of(goal: &Goal, constraints: &Constraints, seed: u64, population: usize) -> Vec<Genome> {
    match goal.area() {
        Some(largest) if goal.has_largest_area() => {
            let areas = FREE_AREAS.map(|area| area.min(largest));
            generation_within(areas, constraints, seed, population)
        }
        area => first_generation(area, constraints, seed, population),
    }
}

/// A first generation with random areas between two.
fn generation_within([least, most]: [f64; 2], constraints: &Constraints, seed: u64, population: usize) -> Vec<Genome> {
    let units = Units::of(constraints.allowed());
    let free = constraints.free_count() as f64 / constraints.membrane().raster.cells() as f64;
    let random = |index| {
        let mut stream = Stream::new(seed, "first generation", index);
        let grain = stream.index(COARSEST + 1);
        let area = if least < most { stream.range(least, most) } else { least };
        Genome::random_within(&units, free * area, constraints.groups(), grain, &mut stream)
    };
    (0..population as u64).map(random).collect()
}

/// Searches for the patterns with the smallest F. The observer receives a report and a checkpoint after every
/// generation. A search resumed from a checkpoint gives the same result to the last bit. A pattern without a field
/// ranks last, and so does a pattern that is not feasible, which is checked for the best of a generation only.
///
/// # Errors
/// If the options are out of range, the predictor fails, or no pattern of the first generation has a field or is
/// feasible.
pub fn evolve(
    problem: &EvolveProblem<'_>,
    options: &EvolveOptions,
    observer: &dyn Observer,
) -> Result<Evolution, EvolveError> {
    options.validate()?;
    let mut search = Search::new(problem, options);
    let mut history = match resume(&mut search, options, observer) {
        Some(history) => history,
        None => start(&mut search, problem, options, observer)?,
    };
    let stop = loop {
        if let Some(stop) = history.end(options) {
            break stop;
        }
        let population = search.evaluated(search.next_generation(&history), observer)?;
        record(&mut history, population, &search, observer)?;
    };
    let winners = search.winners(&history)?;
    Ok(Evolution {
        history: history.reports,
        stop,
        winners,
        evaluations: search.evaluations(),
    })
}

/// The history from the last checkpoint, if there is one.
fn resume(search: &mut Search<'_>, options: &EvolveOptions, observer: &dyn Observer) -> Option<History> {
    let checkpoint = loaded(observer, |bytes| {
        Checkpoint::from_bytes(bytes, options, search.groups())
    })?;
    let history = search.restored(checkpoint);
    if let Some(last) = history.reports.last() {
        observer.resumed(last.generation);
    }
    Some(history)
}

/// What the last checkpoint holds; `None` without one, or if it cannot be used.
fn loaded<T>(observer: &dyn Observer, read: impl FnOnce(&[u8]) -> Result<T, CheckpointError>) -> Option<T> {
    let checkpoint = read(&observer.load_checkpoint()?);
    checkpoint.inspect_err(|error| observer.checkpoint_rejected(error)).ok()
}

/// The first generation.
fn start(
    search: &mut Search<'_>,
    problem: &EvolveProblem<'_>,
    options: &EvolveOptions,
    observer: &dyn Observer,
) -> Result<History, EvolveError> {
    let genomes = first_generation_of(problem.goal, problem.constraints, options.seed, options.population);
    let population = search.evaluated(genomes, observer)?;
    if population[0].evaluation.fitness.is_infinite() {
        return Err(match population.iter().any(|i| i.evaluation.feasible == Some(false)) {
            true => EvolveError::NotFeasible,
            false => EvolveError::NoField,
        });
    }
    let mut history = History::default();
    record(&mut history, population, search, observer)?;
    Ok(history)
}

/// Adds a generation to the history, reports it and stores a checkpoint.
fn record(
    history: &mut History,
    population: Vec<Individual>,
    search: &Search<'_>,
    observer: &dyn Observer,
) -> Result<(), Stopped> {
    history.add(population);
    if let Some(report) = history.reports.last() {
        observer.generation(report);
    }
    observer.save_checkpoint(&|| search.checkpoint(history))
}

#[cfg(test)]
mod tests;
