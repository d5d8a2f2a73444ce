//! Compares solutions with and without an effect, within the work limit of each pattern.

use rayon::prelude::*;

use super::comparison::{Comparison, Displacement};
use super::examine::{Purpose, field_ratio};
use super::test_pattern::TestPattern;
use crate::effects::{Examined, Model, breakdown_strength_or_default};
use crate::grid::Grid;
use crate::sheet::Sheet;
use crate::{MembraneSolver, MeshSolution, SetupError, SolveOptions, WorkLimit};
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Share of the work for a pattern that one solution may take.
const EACH: f64 = 0.25;
/// Ratio of the voltage of a comparison to the critical voltage.
const BELOW: f64 = 0.95;

/// The patterns and their solutions in the current scene.
pub struct Comparer {
    patterns: Vec<(String, Pattern)>,
    /// The same without the shares of cells that electrodes cover, if a pattern has them.
    of_cells: Option<Vec<(String, Pattern)>>,
    purpose: Purpose,
    each: WorkLimit,
    /// Remaining work for each pattern.
    left: Vec<WorkLimit>,
    current: Option<SolvedScene>,
}

/// The solutions of all patterns in one scene on one mesh.
pub struct SolvedScene {
    solver: MembraneSolver,
    /// Whether electrodes cover whole cells, as a fringe field has them.
    is_of_cells: bool,
    solutions: Vec<MeshSolution>,
}

/// Options of the compared solutions. With bilinear elements the influence of a fringe field on a single cell would be
/// wrong by half.
const OPTIONS: SolveOptions = SolveOptions {
    mesh: Mesh::biquadratic(1),
    tolerance: 1e-7,
};

impl Comparer {
    /// Takes the test patterns; `limit` is the work for each of them.
    pub fn new(tests: &[TestPattern], purpose: Purpose, limit: WorkLimit) -> Self {
        let named = |test: &TestPattern| (test.name.clone(), test.pattern.clone());
        let patterns: Vec<_> = tests.iter().map(named).collect();
        let is_covered = patterns.iter().any(|(_, pattern)| pattern.coverage().is_some());
        let of_cells = |(name, pattern): &(String, Pattern)| {
            let (cells, columns) = (pattern.cells(), pattern.raster().columns());
            let pattern = Pattern::from_groups(pattern.raster(), |x, y| cells[y * columns + x]);
            (name.clone(), pattern)
        };
        Self {
            purpose,
            each: limit.part(EACH),
            left: vec![limit; patterns.len()],
            of_cells: is_covered.then(|| patterns.iter().map(of_cells).collect()),
            patterns,
            current: None,
        }
    }

    /// Returns the comparer on grids that resolve the strips of a fringe field, of the patterns that may be the most
    /// influenced by the comparisons of all patterns without such grids.
    pub fn resolving_strips(&self, found: &[Comparison]) -> Self {
        let chosen = Comparison::may_be_largest(found);
        let of = |patterns: &Vec<(String, Pattern)>| chosen.iter().map(|at| patterns[*at].clone()).collect();
        Self {
            patterns: of(&self.patterns),
            of_cells: self.of_cells.as_ref().map(of),
            purpose: Purpose::Table,
            each: self.each,
            left: chosen.iter().map(|at| self.left[*at]).collect(),
            current: None,
        }
    }

    /// Returns the grid for comparing two scenes: that of the one with a fringe field, if any. For warnings the strips
    /// of the field lie within the elements, which takes a ninth of the elements.
    fn elements(&self, [current, other]: [&Scene; 2]) -> Result<Grid, SetupError> {
        let mut scenes = [current, other].into_iter();
        match scenes.find(|scene| scene.effects.fringe_field.is_some()) {
            Some(scene) if self.purpose != Purpose::Warnings => Ok(Model::new(scene)?.grid_of_cells(OPTIONS.mesh)),
            Some(_) => Ok(Grid::uniform(OPTIONS.mesh, &Sheet::of(current))),
            None => Grid::fitted(OPTIONS.mesh, &Sheet::of(current)),
        }
    }

    /// Returns the patterns, with whole cells or as drawn.
    fn patterns(&self, is_of_cells: bool) -> &[(String, Pattern)] {
        self.of_cells.as_ref().filter(|_| is_of_cells).unwrap_or(&self.patterns)
    }

    fn solve(&mut self, scene: &Scene, grid: Grid, is_of_cells: bool) -> Result<SolvedScene, SetupError> {
        let solver = MembraneSolver::on_grid(scene, OPTIONS, grid)?;
        let work = self.patterns(is_of_cells).par_iter().zip(&self.left);
        let solutions: Vec<MeshSolution> = work
            .map(|((_, pattern), left)| solver.solve_within(pattern, self.each.min(*left)))
            .collect();
        for (left, solution) in self.left.iter_mut().zip(&solutions) {
            *left = left.less(solution.work);
        }
        Ok(SolvedScene {
            solver,
            is_of_cells,
            solutions,
        })
    }

    /// Solves for all patterns in another scene, and in the current scene if its solutions are on another grid.
    ///
    /// # Errors
    /// If a scene cannot be simulated.
    pub fn prepare(&mut self, current: &Scene, other: &Scene) -> Result<SolvedScene, SetupError> {
        let grid = self.elements([current, other])?;
        // The difference of both shall be that of the effect, and not that of two kinds of edges.
        let has_fringe = [current, other]
            .iter()
            .any(|scene| scene.effects.fringe_field.is_some());
        let is_of_cells = self.of_cells.is_some() && has_fringe;
        let is_usable = |solved: &SolvedScene| solved.solver.grid == grid && solved.is_of_cells == is_of_cells;
        if !self.current.as_ref().is_some_and(is_usable) {
            self.current = Some(self.solve(current, grid.clone(), is_of_cells)?);
        }
        self.solve(other, grid, is_of_cells)
    }

    /// Returns the field and the outcome of all patterns in the current scene.
    ///
    /// # Errors
    /// If the scene cannot be simulated.
    pub fn examine(&mut self, scene: &Scene) -> Result<Vec<Examined>, SetupError> {
        let solved = match self.current.take().filter(|solved| !solved.is_of_cells) {
            Some(solved) => solved,
            None => {
                let grid = self.elements([scene; 2])?;
                self.solve(scene, grid, false)?
            }
        };
        let breakdown = breakdown_strength_or_default(scene);
        let tests = self.patterns(solved.is_of_cells).iter().zip(&solved.solutions);
        let examined = tests.map(|((name, pattern), solution)| Examined {
            pattern: name.clone(),
            outcome: solution.outcome,
            field: field_ratio(&breakdown, &solved.solver, pattern, solution),
            stability: None,
        });
        let examined = examined.collect();
        self.current = Some(solved);
        Ok(examined)
    }

    /// Makes a scene the current one.
    pub fn adopt(&mut self, scene: SolvedScene) {
        self.current = Some(scene);
    }

    /// Compares the current scene with another one; `other_has_it` says which of them has the effect.
    ///
    /// # Errors
    /// If either scene cannot be simulated at a lower voltage.
    pub fn compare(&mut self, other: &SolvedScene, other_has_it: bool) -> Result<Vec<Comparison>, SetupError> {
        let Some(current) = &self.current else {
            return Ok(Vec::new());
        };
        let sides = if other_has_it {
            [current, other]
        } else {
            [other, current]
        };
        let all = self
            .patterns(current.is_of_cells)
            .par_iter()
            .zip(&self.left)
            .enumerate();
        let found: Vec<(Comparison, u64)> = all
            .map(|(at, ((name, pattern), left))| {
                let solutions = sides.map(|side| &side.solutions[at]);
                let (displacement, work) = displacement(sides, solutions, pattern, self.each.min(*left))?;
                let comparison = Comparison {
                    pattern: name.clone(),
                    outcomes: solutions.map(|solution| solution.outcome),
                    displacement,
                };
                Ok((comparison, work))
            })
            .collect::<Result<_, SetupError>>()?;
        for (left, (_, work)) in self.left.iter_mut().zip(&found) {
            *left = left.less(*work);
        }
        Ok(found.into_iter().map(|(comparison, _)| comparison).collect())
    }
}

/// Compares displacements at the voltage of the scene or, if a solution loses stability before, just below that
/// voltage; also returns the work.
fn displacement(
    [without, with]: [&SolvedScene; 2],
    solutions: [&MeshSolution; 2],
    pattern: &Pattern,
    limit: WorkLimit,
) -> Result<(Option<Displacement>, u64), SetupError> {
    if solutions.iter().all(|solution| solution.outcome.is_converged()) {
        let [before, after] = [(without, solutions[0]), (with, solutions[1])]
            .map(|(side, solution)| side.solver.stroke(pattern, solution));
        let voltage = without.solver.scene.voltage_v();
        return Ok((Some(Displacement::between(&before, &after, voltage)), 0));
    }
    let losses = solutions.iter().filter_map(|solution| solution.outcome.bracket());
    let Some(lowest) = losses
        .map(|[stable, _]| stable)
        .reduce(f64::min)
        .filter(|low| *low > 0.0)
    else {
        return Ok((None, 0));
    };
    let voltage = BELOW * lowest;
    let mut work = 0;
    let mut field_of = |side: &SolvedScene| {
        let scene = side.solver.scene.at_voltage(voltage);
        let solver = MembraneSolver::on_grid(&scene, OPTIONS, side.solver.grid.clone())?;
        let solution = solver.solve_within(pattern, limit);
        work += solution.work;
        Ok(solution
            .outcome
            .is_converged()
            .then(|| solver.stroke(pattern, &solution)))
    };
    let (before, after) = (field_of(without)?, field_of(with)?);
    let displacement = before
        .zip(after)
        .map(|(before, after)| Displacement::between(&before, &after, voltage));
    Ok((displacement, work))
}
