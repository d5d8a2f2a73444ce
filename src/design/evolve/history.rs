//! The generations of a search so far.

use super::options::EvolveOptions;
use super::result::{GenerationReport, Stop};
use super::state::Known;
use crate::genome::Genome;

/// A genome with what is known of it.
pub(super) struct Individual {
    pub genome: Genome,
    pub known: Known,
}

/// The generations of a search so far.
#[derive(Default)]
pub(super) struct History {
    /// The last generation in its order: the best first, or the best of each niche.
    pub population: Vec<Individual>,
    pub reports: Vec<GenerationReport>,
    /// The generation of the last gain.
    pub last_gain: usize,
}

impl History {
    /// Adds the next generation.
    pub fn add(&mut self, population: Vec<Individual>) {
        let generation = self.reports.len();
        let best = &population[0];
        let all = population.iter().map(|individual| individual.known.fitness);
        let finite: Vec<f64> = all.filter(|fitness| fitness.is_finite()).collect();
        let report = GenerationReport {
            generation,
            genome: best.genome.clone(),
            best: best.known.fitness,
            mean: finite.iter().sum::<f64>() / finite.len() as f64,
            value_mm: best.known.value_mm,
            area: best.known.area,
        };
        if self.reports.last().is_some_and(|before| report.best < before.best) {
            self.last_gain = generation;
        }
        self.reports.push(report);
        self.population = population;
    }

    /// Why the search ends here, if it does.
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
