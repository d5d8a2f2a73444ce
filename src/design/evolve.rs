//! The genetic algorithm: designs improve by selection among many, judged by a fast predictor.
//!
//! The procedure of the source paper (Qin et al., doi 10.1089/soro.2024.0063, "GA-based inverse design"): 1000 random
//! individuals of 20 × 20 units; predict, sort; the best 2 % go on unchanged, the rest is recombined by two-point
//! crossover (p 0.7), mutated by inversion (p 0.3) and filtered; 60 iterations. What the paper leaves open: parents win a
//! tournament of two by rank, and the search may end early after a number of generations without gain.
//!
//! Every random choice of a generation is a function of the seed and the generation's number, and equal fitness is
//! ordered by genome, so a search can be repeated from any generation on and does not depend on threads.

use std::collections::HashMap;

use super::genome::Genome;
use super::objective::Goal;
use super::operators::{cross, invert, smooth};
use crate::base::Stream;
use crate::field::{PredictError, Predictor};
use crate::pattern::Pattern;

/// The coarsest grain of the first generation, drawn with the finer ones in equal shares. The paper's first generation is
/// random, not saying how; at an area far from one half single random units would all fall to the filter at once.
const COARSEST: usize = 4;

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvolveOptions {
    /// Individuals in a generation.
    pub population: usize,
    /// Generations bred after the first, random one.
    pub generations: usize,
    /// Share of the best that goes on unchanged; at least one individual does.
    pub elite: f64,
    /// Probability that two parents exchange genes.
    pub crossover: f64,
    /// Probability that a child is mutated.
    pub mutation: f64,
    /// Ends the search after this many generations without gain.
    pub stagnation: Option<usize>,
    /// Names the random choices.
    pub seed: u64,
}

impl Default for EvolveOptions {
    /// The paper's: 1000 individuals, 60 generations, 2 % elite, crossover 0.7, mutation 0.3.
    fn default() -> Self {
        Self {
            population: 1000,
            generations: 60,
            elite: 0.02,
            crossover: 0.7,
            mutation: 0.3,
            stagnation: None,
            seed: 0,
        }
    }
}

/// Options that describe no search.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum OptionsError {
    /// Too few to choose among.
    #[error("a population has at least 2 individuals, found {0}")]
    Population(usize),
    /// Not a share or probability.
    #[error("{name} lies between 0 and 1, found {found}")]
    Share {
        /// Which option.
        name: &'static str,
        /// What was found.
        found: f64,
    },
    /// A search that would end before it begins.
    #[error("stagnation is at least 1 generation")]
    Stagnation,
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum EvolveError {
    /// The options describe no search.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// The predictor failed.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// There is nothing to choose from.
    #[error("no pattern of the first generation has a field: there is nothing to choose from")]
    NoField,
}

/// What is known after a generation.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerationReport {
    /// Number of the generation; 0 is the random one.
    pub generation: usize,
    /// The best individual.
    pub genome: Genome,
    /// F of the best; smaller is better.
    pub best: f64,
    /// Mean F of all individuals with a field.
    pub mean: f64,
    /// Predicted value of the best in mm.
    pub value_mm: f64,
    /// Area fraction of the best.
    pub area: f64,
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// All generations were bred.
    Generations,
    /// There was no gain for as long as the options allow.
    Stagnation,
}

/// A finished search.
#[derive(Clone, Debug, PartialEq)]
pub struct Evolution {
    /// One report for each generation, the random one included; the last holds the best individual of all.
    pub history: Vec<GenerationReport>,
    /// Why it ended.
    pub stop: Stop,
    /// Patterns that were predicted: one that recurs is not predicted again.
    pub evaluations: usize,
}

impl Evolution {
    /// The pattern of the best individual.
    ///
    /// # Panics
    /// Never for the result of [`evolve`], which reports at least the random generation.
    #[must_use]
    pub fn best_pattern(&self) -> Pattern {
        self.history
            .last()
            .expect("there is a first generation")
            .genome
            .pattern()
    }
}

impl EvolveOptions {
    fn validate(&self) -> Result<(), OptionsError> {
        if self.population < 2 {
            return Err(OptionsError::Population(self.population));
        }
        let shares = [
            ("elite", self.elite),
            ("crossover", self.crossover),
            ("mutation", self.mutation),
        ];
        if let Some((name, found)) = shares.into_iter().find(|(_, share)| !(0.0..=1.0).contains(share)) {
            return Err(OptionsError::Share { name, found });
        }
        if self.stagnation == Some(0) {
            return Err(OptionsError::Stagnation);
        }
        Ok(())
    }

    /// How many go on unchanged: never all, or nothing would change.
    fn elites(&self) -> usize {
        let wanted = (self.elite * self.population as f64).round() as usize;
        wanted.clamp(1, self.population - 1)
    }
}

/// Random genomes with the nearest number of units to `area` · 400 on, or each with any number where no area is wanted, from
/// the finest grain to a coarse one: the first generation of a search under a seed, or its beginning.
#[must_use]
pub fn first_generation(area: Option<f64>, seed: u64, population: usize) -> Vec<Genome> {
    let random = |index| {
        let mut stream = Stream::new(seed, "first generation", index);
        let grain = stream.index(COARSEST + 1);
        let area = area.unwrap_or_else(|| stream.uniform());
        Genome::random(area, grain, &mut stream)
    };
    (0..population as u64).map(random).collect()
}

/// Searches for the genome of the least F. `on_generation` hears of every generation once it is judged. A pattern of which
/// the predictor has no field is worse than any other.
///
/// # Errors
/// When the options are out of range, the predictor fails, or it has no field for any pattern of the first generation.
pub fn evolve(
    predictor: &dyn Predictor,
    goal: &Goal,
    options: &EvolveOptions,
    on_generation: &dyn Fn(&GenerationReport),
) -> Result<Evolution, EvolveError> {
    options.validate()?;
    let mut search = Search {
        predictor,
        goal,
        options,
        known: HashMap::new(),
    };
    let mut history: Vec<GenerationReport> = Vec::new();
    let mut last_gain = 0;
    let mut stop = Stop::Generations;
    let mut population = search.judged(first_generation(goal.area(), options.seed, options.population))?;
    if population[0].score.fitness.is_infinite() {
        return Err(EvolveError::NoField);
    }
    for generation in 0..=options.generations {
        if generation > 0 {
            population = search.judged(search.bred(&population, generation))?;
        }
        let report = search.report(generation, &population);
        if history.last().is_some_and(|before| report.best < before.best) {
            last_gain = generation;
        }
        on_generation(&report);
        history.push(report);
        if options.stagnation.is_some_and(|limit| generation - last_gain >= limit) && generation < options.generations {
            stop = Stop::Stagnation;
            break;
        }
    }
    Ok(Evolution {
        history,
        stop,
        evaluations: search.known.len(),
    })
}

/// What is known of a genome; its fitness is infinite where it has no field.
#[derive(Clone, Copy)]
struct Score {
    fitness: f64,
    value_mm: f64,
    area: f64,
}

struct Individual {
    genome: Genome,
    score: Score,
}

struct Search<'a> {
    predictor: &'a dyn Predictor,
    goal: &'a Goal,
    options: &'a EvolveOptions,
    known: HashMap<Genome, Score>,
}

impl Search<'_> {
    /// The next generation of a sorted one.
    fn bred(&self, population: &[Individual], generation: usize) -> Vec<Genome> {
        let size = self.options.population;
        let mut stream = Stream::new(self.options.seed, "generation", generation as u64);
        let mut next: Vec<Genome> = population[..self.options.elites()]
            .iter()
            .map(|i| i.genome.clone())
            .collect();
        while next.len() < size {
            let (mut a, mut b) = (parent(population, &mut stream), parent(population, &mut stream));
            if stream.chance(self.options.crossover) {
                cross(&mut a, &mut b, &mut stream);
            }
            for mut child in [a, b] {
                if stream.chance(self.options.mutation) {
                    invert(&mut child, &mut stream);
                }
                next.push(smooth(&child));
            }
        }
        next.truncate(size);
        next
    }

    /// The individuals of these genomes, best first.
    fn judged(&mut self, genomes: Vec<Genome>) -> Result<Vec<Individual>, PredictError> {
        let mut unknown: Vec<&Genome> = genomes.iter().filter(|g| !self.known.contains_key(*g)).collect();
        unknown.sort_unstable();
        unknown.dedup();
        let patterns: Vec<Pattern> = unknown.iter().map(|genome| genome.pattern()).collect();
        let fields = self.predictor.predict_some(&patterns)?;
        if fields.len() != patterns.len() {
            return Err(PredictError(format!(
                "{} fields for {} patterns",
                fields.len(),
                patterns.len()
            )));
        }
        for ((genome, pattern), field) in unknown.into_iter().zip(&patterns).zip(&fields) {
            let score = Score {
                fitness: field
                    .as_ref()
                    .map_or(f64::INFINITY, |field| self.goal.fitness(pattern, field)),
                value_mm: field.as_ref().map_or(0.0, |field| self.goal.value_mm(field)),
                area: pattern.area_fraction(),
            };
            self.known.insert(genome.clone(), score);
        }
        let individual = |genome: Genome| Individual {
            score: self.known[&genome],
            genome,
        };
        let mut population: Vec<Individual> = genomes.into_iter().map(individual).collect();
        population.sort_by(|a, b| {
            a.score
                .fitness
                .total_cmp(&b.score.fitness)
                .then_with(|| a.genome.cmp(&b.genome))
        });
        Ok(population)
    }

    fn report(&self, generation: usize, population: &[Individual]) -> GenerationReport {
        let best = &population[0];
        let judged = population.iter().map(|individual| individual.score.fitness);
        let judged: Vec<f64> = judged.filter(|fitness| fitness.is_finite()).collect();
        GenerationReport {
            generation,
            genome: best.genome.clone(),
            best: best.score.fitness,
            mean: judged.iter().sum::<f64>() / judged.len() as f64,
            value_mm: best.score.value_mm,
            area: best.score.area,
        }
    }
}

/// The better of two random individuals of a sorted population.
fn parent(population: &[Individual], stream: &mut Stream) -> Genome {
    let rank = stream.index(population.len()).min(stream.index(population.len()));
    population[rank].genome.clone()
}

#[cfg(test)]
mod tests;
