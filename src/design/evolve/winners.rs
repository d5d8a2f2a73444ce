//! The designs that a search has found.

use super::history::History;
use super::niche::Niches;
use super::result::Winner;
use super::search::{CacheEntry, Search};
use crate::genome::Genome;
use deaflow_field::PredictError;

impl Search<'_> {
    /// The best individual, then the best judged ones that satisfy the constraints, are feasible and have the minimum
    /// distance from those before.
    pub fn winners(&self, history: &History) -> Result<Vec<Winner>, PredictError> {
        let best = &history.population[0].genome;
        let mut winners = vec![self.winner(best)];
        if self.options.designs == 1 {
            return Ok(winners);
        }
        let equivalence = self.problem.constraints.equivalence();
        let mut niches = Niches::new(self.options.designs, self.options.distance, equivalence);
        niches.add(&self.cache[best].layers);
        let judged = self.cache.iter();
        let judged = judged.filter(|(_, entry)| entry.evaluation.judged && entry.evaluation.fitness.is_finite());
        let mut sorted: Vec<(f64, Genome)> = judged.map(|(g, entry)| (entry.evaluation.fitness, g.clone())).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
        for (_, genome) in sorted {
            if niches.are_full() {
                break;
            }
            let CacheEntry { evaluation, layers, .. } = &self.cache[&genome];
            if !niches.are_far_from(layers) || !self.problem.constraints.satisfied_by_layers(layers) {
                continue;
            }
            let is_feasible = match evaluation.feasible {
                Some(feasible) => feasible,
                None => self.feasible(std::slice::from_ref(&genome))?.first().is_none_or(|&v| v),
            };
            if is_feasible {
                niches.add(layers);
                winners.push(self.winner(&genome));
            }
        }
        Ok(winners)
    }

    fn winner(&self, genome: &Genome) -> Winner {
        let CacheEntry { evaluation, layers, .. } = &self.cache[genome];
        let pattern = layers.pattern();
        Winner {
            genome: genome.clone(),
            fitness: evaluation.fitness,
            value_mm: evaluation.value_mm,
            area: evaluation.area,
            violations: self.problem.constraints.violations(&pattern),
            pattern,
        }
    }
}
