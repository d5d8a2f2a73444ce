//! Reports and results of the genetic algorithm.

use crate::constraint::Violations;
use crate::genome::Genome;
use deaflow_base::Stopped;
use deaflow_pattern::Pattern;

use super::checkpoint::CheckpointError;

/// The report of a generation.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerationReport {
    /// The number of the generation; 0 is the random one.
    pub generation: usize,
    /// The best individual.
    pub genome: Genome,
    /// F of the best individual; smaller is better.
    pub best: f64,
    /// Mean F of all individuals with a field; of those not judged, F by the rough score.
    pub mean: f64,
    /// Predicted value of the best individual in mm.
    pub value_mm: f64,
    /// Area fraction of the best individual.
    pub area: f64,
}

/// The report of a generation of the search of a front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrontReport {
    /// The number of the generation; 0 is the first one.
    pub generation: usize,
    /// The number of designs of which no other one is better in all objectives.
    pub designs: usize,
    /// The largest value of the first objective.
    pub best: f64,
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The maximum number of generations was reached.
    Generations,
    /// There was no improvement for the number of generations in the options.
    Stagnation,
}

/// A design, the winner of a niche.
#[derive(Clone, Debug, PartialEq)]
pub struct Winner {
    /// The genome.
    pub genome: Genome,
    /// The pattern of the genome, repaired if there are constraints.
    pub pattern: Pattern,
    /// F; smaller is better.
    pub fitness: f64,
    /// Predicted value in mm.
    pub value_mm: f64,
    /// Area fraction.
    pub area: f64,
    /// The violated constraints.
    pub violations: Violations,
}

/// A finished search.
#[derive(Clone, Debug, PartialEq)]
pub struct Evolution {
    /// One report for each generation, including the random one; the last one has the best individual of all.
    pub history: Vec<GenerationReport>,
    /// Why the search ended.
    pub stop: Stop,
    /// The designs, best first: the best of all, then the best that satisfy the constraints and have the minimum
    /// distance from those before. There may be fewer than requested.
    pub winners: Vec<Winner>,
    /// The number of patterns that were judged; each pattern is judged once.
    pub evaluations: usize,
}

impl Evolution {
    /// The best pattern.
    ///
    /// # Panics
    /// Never for the result of [`evolve`](super::evolve), which has at least one winner.
    #[must_use]
    pub fn best_pattern(&self) -> Pattern {
        self.winners.first().expect("a search has a winner").pattern.clone()
    }
}

/// Observes a search and stores its checkpoints. Only [`Observer::generation`] is required.
pub trait Observer {
    /// Called after each generation.
    fn generation(&self, report: &GenerationReport);

    /// Called within a slow generation: the share of its patterns that are judged.
    fn judged(&self, _share: f64) {}

    /// The last checkpoint, if any.
    fn load_checkpoint(&self) -> Option<Vec<u8>> {
        None
    }

    /// Called after each generation to store a checkpoint, which `checkpoint` encodes.
    ///
    /// # Errors
    /// If the search is to stop.
    fn save_checkpoint(&self, _checkpoint: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        Ok(())
    }

    /// Called after each generation of the search of a front.
    fn front(&self, _report: &FrontReport) {}

    /// Called first if the search is resumed from a checkpoint, with the number of its last generation.
    fn resumed(&self, _generation: usize) {}

    /// Called if a checkpoint cannot be used; the search starts from the beginning.
    fn checkpoint_rejected(&self, _error: &CheckpointError) {}
}

impl<F: Fn(&GenerationReport)> Observer for F {
    fn generation(&self, report: &GenerationReport) {
        self(report);
    }
}
