//! What a search tells on its way, and what it has found.

use crate::constraint::Violations;
use crate::genome::Genome;
use deaflow_base::Stopped;
use deaflow_pattern::Pattern;

use super::state::StateError;

/// What is known after a generation.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerationReport {
    /// Number of the generation; 0 is the random one.
    pub generation: usize,
    /// The best individual.
    pub genome: Genome,
    /// F of the best; smaller is better.
    pub best: f64,
    /// Mean F of all individuals with a field, the rough F of those that were not judged.
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

/// A design that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Winner {
    /// Its genome.
    pub genome: Genome,
    /// Its pattern: that of the genome, repaired where constraints ask for it.
    pub pattern: Pattern,
    /// F; smaller is better.
    pub fitness: f64,
    /// Predicted value in mm.
    pub value_mm: f64,
    /// Area fraction.
    pub area: f64,
    /// What of the pattern does not keep the constraints.
    pub violations: Violations,
}

/// A finished search.
#[derive(Clone, Debug, PartialEq)]
pub struct Evolution {
    /// One report for each generation, the random one included; the last holds the best individual of all.
    pub history: Vec<GenerationReport>,
    /// Why it ended.
    pub stop: Stop,
    /// The designs, best first: the best of all, then the best that differ from those before by the wanted distance and keep the
    /// constraints. There may be fewer than wanted.
    pub winners: Vec<Winner>,
    /// Patterns that were judged: one that recurs is not judged again.
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

/// Follows a search, and keeps what it needs to be gone on with. All that is left out does nothing.
pub trait Watch {
    /// After each generation, once it is judged.
    fn generation(&self, report: &GenerationReport);

    /// Within a generation: which part of its patterns is judged. Nothing is said of generations that are judged at once.
    fn judged(&self, part: f64) {
        let _ = part;
    }

    /// The state that was last kept, if any.
    fn kept(&self) -> Option<Vec<u8>> {
        None
    }

    /// After each generation: the state, for whoever wants to keep it. It is made when `state` is called.
    ///
    /// # Errors
    /// When the search is to stop here.
    fn keep(&self, state: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        let _ = state;
        Ok(())
    }

    /// Before anything else, when the search goes on from a state that was kept: the report of the last generation that it
    /// had come to.
    fn resumed(&self, report: &GenerationReport) {
        let _ = report;
    }

    /// A state that was kept, but cannot be gone on from: the search starts anew.
    fn unusable(&self, error: &StateError) {
        let _ = error;
    }
}

impl<F: Fn(&GenerationReport)> Watch for F {
    fn generation(&self, report: &GenerationReport) {
        self(report);
    }
}
