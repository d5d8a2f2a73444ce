//! Conversion between a search and its checkpoints.

use rayon::prelude::*;

use super::checkpoint::{Checkpoint, Evaluation, StoredGeneration};
use super::history::{History, Individual};
use super::result::GenerationReport;
use super::search::{CacheEntry, Search};
use crate::genome::Genome;

impl Search<'_> {
    /// The encoded checkpoint after a generation.
    pub fn checkpoint(&self, history: &History) -> Option<Vec<u8>> {
        let cached = self.cache.iter();
        let mut known: Vec<(Genome, Evaluation)> = cached.map(|(g, entry)| (g.clone(), entry.evaluation)).collect();
        known.sort_unstable_by(|a, b| a.0.cmp(&b.0));
        let index = |genome: &Genome| {
            let found = known.binary_search_by(|(other, _)| other.cmp(genome));
            found.ok().map(|index| index as u64)
        };
        let step = |report: &GenerationReport| {
            Some(StoredGeneration {
                genome: index(&report.genome)?,
                best: report.best,
                mean: report.mean,
                value_mm: report.value_mm,
                area: report.area,
            })
        };
        let population = history.population.iter().map(|individual| index(&individual.genome));
        let checkpoint = Checkpoint {
            population: population.collect::<Option<_>>()?,
            history: history.reports.iter().map(step).collect::<Option<_>>()?,
            last_gain: history.last_gain as u64,
            known,
        };
        checkpoint.to_bytes(self.options, self.groups())
    }

    /// Restores the cache, and returns the history.
    pub fn restored(&mut self, checkpoint: Checkpoint) -> History {
        let genome = |index: u64| checkpoint.known[index as usize].0.clone();
        let individual = |&index: &u64| Individual {
            genome: genome(index),
            evaluation: checkpoint.known[index as usize].1,
        };
        let report = |(generation, step): (usize, &StoredGeneration)| GenerationReport {
            generation,
            genome: genome(step.genome),
            best: step.best,
            mean: step.mean,
            value_mm: step.value_mm,
            area: step.area,
        };
        let history = History {
            population: checkpoint.population.iter().map(individual).collect(),
            reports: checkpoint.history.iter().enumerate().map(report).collect(),
            last_gain: checkpoint.last_gain as usize,
        };
        let entry = |(genome, evaluation)| {
            let entry = self.entry(&genome);
            (genome, CacheEntry { evaluation, ..entry })
        };
        self.cache = checkpoint.known.into_par_iter().map(entry).collect();
        history
    }
}
