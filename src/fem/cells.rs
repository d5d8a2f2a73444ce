//! Solutions with the state of every cell.

use rayon::prelude::*;

use deaflow_field::Simulation;
use deaflow_pattern::Pattern;

use super::observable::{CellState, ROUNDING, Tension};
use super::solver::{MembraneSolver, MeshSolution};

impl MembraneSolver {
    /// Returns the displacement in mm of the corners of elements, `[y][x]`.
    #[must_use]
    pub fn corner_displacements(&self, solution: &MeshSolution) -> Vec<[f64; 2]> {
        let (layout, unit) = (self.grid.layout(), self.grid.unit_mm());
        let ([columns, rows], degree) = (self.grid.elements().map(|count| count + 1), layout.degree());
        let at = |corner: usize, c: usize| layout.index(c, corner % columns * degree, corner / columns * degree);
        (0..columns * rows)
            .map(|corner| [0, 1].map(|c| unit * solution.displacement[at(corner, c)]))
            .collect()
    }

    /// Returns the positions without displacement in mm of the corners of elements, `[y][x]`.
    #[must_use]
    pub fn corner_places(&self) -> Vec<[f64; 2]> {
        let (elements, size) = (self.grid.elements(), self.scene.membrane().size_mm);
        let (degree, unit) = (self.grid.layout().degree(), self.grid.unit_mm());
        let [columns, rows] = elements.map(|count| count + 1);
        let place = |corner: [usize; 2]| match self.grid.follows_borders() {
            Some(_) => {
                let position = self.grid.node_position(corner.map(|at| at * degree));
                position.map(|at| unit * at)
            }
            None => [0, 1].map(|axis| size[axis] / elements[axis] as f64 * self.grid.start(axis, corner[axis])),
        };
        (0..columns * rows)
            .map(|corner| place([corner % columns, corner / columns]))
            .collect()
    }

    /// Simulates patterns and returns the states of their cells, `[y][x]`; `None` without a stable solution.
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

/// Returns the share of the membrane that is wrinkled or slack.
#[must_use]
pub fn wrinkled_fraction(states: &[CellState]) -> f64 {
    let wrinkled = states.iter().filter(|state| state.tension != Tension::Taut).count();
    wrinkled as f64 / states.len() as f64
}

/// The compression above which flat membrane is counted as compressed, in units of the median of the larger principal
/// stress. Free edges of strips in tension are under a smaller one, without any consequence.
const COMPRESSED: f64 = 0.01;

/// Returns the share of flat membrane of a shear modulus that is compressed, and would wrinkle or become slack.
#[must_use]
pub(super) fn compressed_fraction(states: &[CellState], modulus_pa: f64) -> f64 {
    let mut largest: Vec<f64> = states.iter().map(|state| state.stresses[0]).collect();
    largest.sort_by(f64::total_cmp);
    let median = largest.get(largest.len() / 2).map_or(0.0, |median| median.abs());
    let bound = f64::max(COMPRESSED * median, ROUNDING * modulus_pa);
    let compressed = states.iter().filter(|state| state.stresses[1] < -bound).count();
    compressed as f64 / states.len() as f64
}
