//! The generations of a search so far.

use super::checkpoint::Evaluation;
use super::options::EvolveOptions;
use super::result::{GenerationReport, Stop};
use crate::genome::Genome;

/// A genome and its evaluation.
pub(super) struct Individual {
    pub genome: Genome,
    pub evaluation: Evaluation,
}

/// The generations of a search so far.
#[derive(Default)]
pub(super) struct History {
    /// The last generation in its order: the best first, or the best of each niche.
    pub population: Vec<Individual>,
    pub reports: Vec<GenerationReport>,
    /// The last generation with an improvement.
    pub last_gain: usize,
}

impl History {
    /// Adds the next generation.
    pub fn add(&mut self, population: Vec<Individual>) {
        let generation = self.reports.len();
        let best = &population[0];
        let all = population.iter().map(|individual| individual.evaluation.fitness);
        let finite: Vec<f64> = all.filter(|fitness| fitness.is_finite()).collect();
        let report = GenerationReport {
            generation,
            genome: best.genome.clone(),
            best: best.evaluation.fitness,
            mean: finite.iter().sum::<f64>() / finite.len() as f64,
            value_mm: best.evaluation.value_mm,
            area: best.evaluation.area,
        };
        if self.reports.last().is_some_and(|before| report.best < before.best) {
            self.last_gain = generation;
        }
        self.reports.push(report);
        self.population = population;
    }

    /// Why the search ends at this generation; `None` if it continues.
    pub fn end(&self, options: &EvolveOptions) -> Option<Stop> {
        let generation = self.reports.len().saturating_sub(1);
        if generation >= options.generations {
            return Some(Stop::Generations);
        }
        let stagnant = options
            .stagnation
            .is_some_and(|limit| generation - self.last_gain >= limit);
        stagnant.then_some(Stop::Stagnation)
    }
}
