//! Solutions with the state of every cell: what an engineer asks of a membrane beside its displacement.

use rayon::prelude::*;

use crate::field::Simulation;
use crate::pattern::Pattern;

use super::observable::{CellState, Tension};
use super::solver::MembraneSolver;

impl MembraneSolver {
    /// Simulates patterns and keeps the states of their cells, `[y][x]`; `None` where there is no stable solution.
    #[must_use]
    pub fn simulate_cells(&self, patterns: &[Pattern]) -> Vec<(Simulation, Option<Vec<CellState>>)> {
        let each = |pattern: &Pattern| {
            let solution = self.solve(pattern);
            let converged = solution.outcome.is_converged();
            let states = converged.then(|| self.cell_states(pattern, &solution));
            (self.simulation(pattern, &solution), states)
        };
        patterns.par_iter().map(each).collect()
    }
}

/// The part of the membrane that is wrinkled or slack.
#[must_use]
pub fn wrinkled_fraction(states: &[CellState]) -> f64 {
    let wrinkled = states.iter().filter(|state| state.tension != Tension::Taut).count();
    wrinkled as f64 / states.len() as f64
}
