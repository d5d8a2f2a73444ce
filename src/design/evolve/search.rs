//! The evaluation of generations, with a cache of all evaluated genomes.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::EvolveProblem;
use super::checkpoint::Evaluation;
use super::history::Individual;
use super::niche::order;
use super::options::EvolveOptions;
use super::result::Observer;
use crate::constraint::Constraints;
use crate::genome::{Genome, Units};
use deaflow_field::{Feasibility, PredictError, Predictor, StateFields};
use deaflow_pattern::{Layers, Pattern};

/// The penalty in F for any violated constraint: as much as 2.5 mm.
const VIOLATION_PENALTY: f64 = 1.0;

/// The penalty in F for each share of the membrane that violates constraints.
const VIOLATED_SHARE_PENALTY: f64 = 10.0;

/// The minimum number of patterns that are judged at once; progress is reported in between. A network predicts this
/// number at once on each thread, so that multiples of it are divided evenly.
const MIN_BATCH: usize = 64;

/// Batches that take less time are doubled, batches that take ten times as long are halved.
const BATCH_TIME: Duration = Duration::from_millis(100);

/// The evaluation of a genome, and its pattern.
pub(super) struct CacheEntry {
    pub evaluation: Evaluation,
    /// F by the rough score; NaN without one.
    pub rough: f64,
    pub layers: Layers,
}

/// A running search.
pub(super) struct Search<'a> {
    pub problem: &'a EvolveProblem<'a>,
    pub options: &'a EvolveOptions,
    /// The units of the membrane.
    pub units: Units,
    pub cache: HashMap<Genome, CacheEntry>,
    batches: Batches,
}

/// Predicts patterns in batches, so that progress can be reported in between.
pub(super) struct Batches {
    /// The number of patterns in the next one.
    size: usize,
}

impl Default for Batches {
    fn default() -> Self {
        Self {
            size: MIN_BATCH * rayon::current_num_threads().next_power_of_two(),
        }
    }
}

impl Batches {
    /// The fields of patterns; `on_batch` receives the number of patterns after each batch but the last.
    pub fn predict(
        &mut self,
        predictor: &dyn Predictor<StateFields>,
        patterns: &[Pattern],
        on_batch: &dyn Fn(usize),
    ) -> Result<Vec<Option<StateFields>>, PredictError> {
        let mut fields = Vec::with_capacity(patterns.len());
        let mut done = 0;
        while done < patterns.len() {
            let start = Instant::now();
            let batch = &patterns[done..patterns.len().min(done + self.size)];
            fields.extend(predictor.predict_some(batch)?);
            done += batch.len();
            if done < patterns.len() {
                self.size = next_batch(self.size, start.elapsed());
                on_batch(done);
            }
        }
        check_count(fields.len(), "fields", patterns.len())?;
        Ok(fields)
    }
}

impl<'a> Search<'a> {
    pub fn new(problem: &'a EvolveProblem<'a>, options: &'a EvolveOptions) -> Self {
        Self {
            problem,
            options,
            units: Units::of(problem.constraints.allowed()),
            cache: HashMap::new(),
            batches: Batches::default(),
        }
    }

    /// The number of electrode groups.
    pub fn groups(&self) -> usize {
        self.problem.constraints.groups()
    }

    /// The number of patterns that were judged.
    pub fn evaluations(&self) -> usize {
        self.cache.values().filter(|entry| entry.evaluation.judged).count()
    }

    /// The sorted individuals of some genomes. With a rough score, only as many of the best as the options request are
    /// judged.
    pub fn evaluated(
        &mut self,
        genomes: Vec<Genome>,
        observer: &dyn Observer,
    ) -> Result<Vec<Individual>, PredictError> {
        self.add_to_cache(&genomes);
        let individual = |genome: Genome| Individual {
            evaluation: self.cache[&genome].evaluation,
            genome,
        };
        let mut population: Vec<Individual> = genomes.into_iter().map(individual).collect();
        let (best, mut next) = match self.problem.rough {
            Some(_) => (self.options.judged_count(), Vec::new()),
            None => (population.len(), unjudged(&population)),
        };
        let mut judged = 0;
        loop {
            if !next.is_empty() {
                self.judge(&next, (judged, best), observer)?;
                judged += next.len();
            }
            self.refresh(&mut population);
            self.sort(&mut population);
            next = unjudged(&population[..best]);
            if next.is_empty() && !self.check_feasibility(&population)? {
                return Ok(population);
            }
        }
    }

    /// Adds new genomes with their rough score.
    fn add_to_cache(&mut self, genomes: &[Genome]) {
        let unknown = distinct(genomes.iter().filter(|genome| !self.cache.contains_key(*genome)));
        let entries: Vec<CacheEntry> = unknown.par_iter().map(|genome| self.entry(genome)).collect();
        self.cache.extend(unknown.into_iter().zip(entries));
    }

    pub fn entry(&self, genome: &Genome) -> CacheEntry {
        let (pattern, layers) = pattern_of(genome, self.problem.constraints);
        let score = self.problem.rough.map(|rough| rough.score(&pattern));
        let rough = score.map_or(f64::NAN, |score| self.fitness(&pattern, score));
        CacheEntry {
            evaluation: Evaluation {
                fitness: rough,
                value_mm: 0.0,
                area: self.problem.constraints.area_fraction(&pattern),
                judged: false,
                feasible: None,
            },
            rough,
            layers,
        }
    }

    /// Judges genomes by the evaluator. `before` patterns of their generation were judged before, of at least `all`.
    fn judge(
        &mut self,
        genomes: &[Genome],
        (before, all): (usize, usize),
        observer: &dyn Observer,
    ) -> Result<(), PredictError> {
        let patterns = self.patterns(genomes);
        let all = all.max(before + genomes.len()) as f64;
        let on_judged = |count: usize| observer.judged((before + count) as f64 / all);
        let evaluations = self.predicted(&patterns, &on_judged)?;
        for (genome, evaluation) in genomes.iter().zip(evaluations) {
            if let Some(entry) = self.cache.get_mut(genome) {
                entry.evaluation = evaluation;
            }
        }
        Ok(())
    }

    fn patterns(&self, genomes: &[Genome]) -> Vec<Pattern> {
        let layers = genomes.iter().map(|genome| &self.cache[genome].layers);
        layers.map(Layers::pattern).collect()
    }

    /// Updates a population from the cache. The rough F of a generation has a systematic error, so it is shifted by
    /// the mean difference between F and rough F of the judged individuals.
    fn refresh(&self, population: &mut [Individual]) {
        let entries = population.iter().map(|individual| &self.cache[&individual.genome]);
        let judged = entries.filter(|entry| entry.evaluation.judged);
        let errors = judged.map(|entry| entry.evaluation.fitness - entry.rough);
        let errors: Vec<f64> = errors.filter(|error| error.is_finite()).collect();
        let shift = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        for individual in population {
            individual.evaluation = self.cache[&individual.genome].evaluation;
            if !individual.evaluation.judged {
                individual.evaluation.fitness += shift;
            }
        }
    }

    /// Predicts and evaluates patterns in batches; `on_batch` receives the number of patterns after each batch but the
    /// last.
    fn predicted(&mut self, patterns: &[Pattern], on_batch: &dyn Fn(usize)) -> Result<Vec<Evaluation>, PredictError> {
        let fields = self.batches.predict(self.problem.predictor, patterns, on_batch)?;
        let goal = self.problem.goal;
        let evaluation = |(pattern, fields): (&Pattern, &Option<StateFields>)| Evaluation {
            fitness: fields
                .as_ref()
                .map_or(f64::INFINITY, |fields| self.fitness(pattern, goal.score(fields))),
            value_mm: fields.as_ref().map_or(0.0, |fields| goal.value_mm(fields)),
            area: self.problem.constraints.area_fraction(pattern),
            judged: true,
            feasible: None,
        };
        Ok(patterns.iter().zip(&fields).map(evaluation).collect())
    }

    fn fitness(&self, pattern: &Pattern, score: f64) -> f64 {
        let constraints = self.problem.constraints;
        let fitness = self.problem.goal.fitness_of(constraints.area_fraction(pattern), score);
        if constraints.allow_any_pattern() || constraints.satisfied_by(pattern) {
            return fitness;
        }
        fitness + VIOLATION_PENALTY + VIOLATED_SHARE_PENALTY * constraints.violations(pattern).share()
    }

    /// Sorts by fitness, then genome; for several designs, then by niches. Individuals without a field come last.
    fn sort(&self, population: &mut Vec<Individual>) {
        population.sort_by(|a, b| {
            let by_fitness = a.evaluation.fitness.total_cmp(&b.evaluation.fitness);
            by_fitness.then_with(|| a.genome.cmp(&b.genome))
        });
        if self.options.designs == 1 {
            return;
        }
        let finite = population.partition_point(|individual| individual.evaluation.fitness.is_finite());
        let layers: Vec<Layers> = population[..finite]
            .iter()
            .map(|individual| self.cache[&individual.genome].layers.clone())
            .collect();
        let equivalence = self.problem.constraints.equivalence();
        let order = order(&layers, self.options.designs, self.options.distance, equivalence);
        let mut sorted: Vec<Option<Individual>> = population.drain(..).map(Some).collect();
        let indices = order.into_iter().chain(finite..sorted.len());
        population.extend(indices.filter_map(|index| sorted[index].take()));
    }

    /// Checks the feasibility of the best individuals. Returns whether one of them was found to be infeasible.
    fn check_feasibility(&mut self, population: &[Individual]) -> Result<bool, PredictError> {
        let best = population[..self.options.elites()].iter();
        let unchecked = best.filter(|i| i.evaluation.fitness.is_finite() && i.evaluation.feasible.is_none());
        let genomes = distinct(unchecked.map(|individual| &individual.genome));
        let mut is_any_infeasible = false;
        for (genome, feasible) in genomes.iter().zip(self.feasible(&genomes)?) {
            if let Some(entry) = self.cache.get_mut(genome) {
                entry.evaluation.feasible = Some(feasible);
                if !feasible {
                    entry.evaluation.fitness = f64::INFINITY;
                }
            }
            is_any_infeasible |= !feasible;
        }
        Ok(is_any_infeasible)
    }

    /// Whether each genome is feasible; empty without a feasibility check.
    pub fn feasible(&self, genomes: &[Genome]) -> Result<Vec<bool>, PredictError> {
        let Some(feasibility) = self.problem.feasibility.filter(|_| !genomes.is_empty()) else {
            return Ok(Vec::new());
        };
        verdicts(feasibility, &self.patterns(genomes))
    }
}

/// Whether each pattern is feasible.
pub(super) fn verdicts(feasibility: &dyn Feasibility, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
    let verdicts = feasibility.feasible(patterns)?;
    check_count(verdicts.len(), "verdicts", patterns.len())?;
    Ok(verdicts)
}

/// The pattern of a genome, repaired if there are constraints. A pattern that cannot be repaired only loses the cells
/// that are not allowed.
pub(super) fn pattern_of(genome: &Genome, constraints: &Constraints) -> (Pattern, Layers) {
    let pattern = genome.pattern(constraints.membrane().raster);
    let layers = constraints.layers(&pattern);
    if constraints.allow_any_pattern() {
        return (pattern, layers);
    }
    let repaired = constraints.repaired_layers(&layers);
    let layers = repaired.unwrap_or_else(|| constraints.layers(&constraints.masked(&pattern)));
    (layers.pattern(), layers)
}

/// The size of the next batch, given the size and the time of the last one.
fn next_batch(batch: usize, time: Duration) -> usize {
    if time < BATCH_TIME {
        2 * batch
    } else if time > 10 * BATCH_TIME {
        MIN_BATCH.max(batch / 2)
    } else {
        batch
    }
}

/// The distinct genomes of individuals that were not judged.
fn unjudged(individuals: &[Individual]) -> Vec<Genome> {
    let unjudged = individuals.iter().filter(|individual| !individual.evaluation.judged);
    distinct(unjudged.map(|individual| &individual.genome))
}

/// Sorts genomes and removes duplicates.
fn distinct<'g>(genomes: impl Iterator<Item = &'g Genome>) -> Vec<Genome> {
    let mut genomes: Vec<Genome> = genomes.cloned().collect();
    genomes.sort_unstable();
    genomes.dedup();
    genomes
}

fn check_count(found: usize, what: &str, patterns: usize) -> Result<(), PredictError> {
    match found == patterns {
        true => Ok(()),
        false => Err(PredictError::failed(format!("{found} {what} for {patterns} patterns"))),
    }
}
