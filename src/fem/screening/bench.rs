//! Where solutions with an effect are compared with solutions without it, within the work that each pattern is allowed.

use rayon::prelude::*;

use super::comparison::{Comparison, Displacement};
use super::trial::Trial;
use crate::effects::Model;
use crate::grid::Grid;
use crate::sheet::Sheet;
use crate::{MembraneSolver, MeshSolution, SetupError, SolveOptions, WorkLimit};
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// The part of all work of a pattern that one solution may take.
const EACH: f64 = 0.25;
/// The voltage of a comparison over that at which stability is lost.
const BELOW: f64 = 0.95;

/// The patterns, and what is known of them in the scene as it stands.
pub struct Bench {
    patterns: Vec<(String, Pattern)>,
    each: WorkLimit,
    /// The work that is left for each pattern.
    left: Vec<WorkLimit>,
    current: Option<Side>,
}

/// The solutions of all patterns in one scene on one mesh.
pub struct Side {
    solver: MembraneSolver,
    solutions: Vec<MeshSolution>,
}

/// How solutions that are compared are found. Bilinear elements would get the effect of a fringe field on a single cell wrong by half.
const OPTIONS: SolveOptions = SolveOptions {
    mesh: Mesh::biquadratic(1),
    tolerance: 1e-7,
};

/// The elements on which two scenes are compared: those that the one with a fringe field wants.
fn elements([current, other]: [&Scene; 2]) -> Result<Grid, SetupError> {
    let fringed = [current, other]
        .into_iter()
        .find(|scene| scene.effects.fringe_field.is_some());
    match fringed {
        Some(scene) => Ok(Model::new(scene)?.grid(OPTIONS.mesh)),
        None => Ok(Grid::uniform(OPTIONS.mesh, &Sheet::of(current))),
    }
}

impl Bench {
    /// The patterns of `trials` that are compared; `limit` is the work for each of them.
    pub fn new(trials: &[Trial], limit: WorkLimit) -> Self {
        let compared = trials.iter().filter(|trial| trial.compared);
        let patterns: Vec<_> = compared
            .map(|trial| (trial.name.clone(), trial.pattern.clone()))
            .collect();
        Self {
            each: limit.part(EACH),
            left: vec![limit; patterns.len()],
            patterns,
            current: None,
        }
    }

    fn solve(&mut self, scene: &Scene, grid: Grid) -> Result<Side, SetupError> {
        let solver = MembraneSolver::on_grid(scene, OPTIONS, grid)?;
        let work = self.patterns.par_iter().zip(&self.left);
        let solutions: Vec<MeshSolution> = work
            .map(|((_, pattern), left)| solver.solve_within(pattern, self.each.min(*left)))
            .collect();
        for (left, solution) in self.left.iter_mut().zip(&solutions) {
            *left = left.less(solution.work);
        }
        Ok(Side { solver, solutions })
    }

    /// Solves for all patterns in another scene than that as it stands, whose solutions are known on the same elements from then on.
    ///
    /// # Errors
    /// When a scene cannot be simulated.
    pub fn prepare(&mut self, current: &Scene, other: &Scene) -> Result<Side, SetupError> {
        let grid = elements([current, other])?;
        if self.current.as_ref().is_none_or(|side| side.solver.grid != grid) {
            self.current = Some(self.solve(current, grid.clone())?);
        }
        self.solve(other, grid)
    }

    /// Takes a side for that of the scene as it stands from here on.
    pub fn adopt(&mut self, side: Side) {
        self.current = Some(side);
    }

    /// Compares the scene as it stands with another one, which has the effect where `other_has_it` and lacks it otherwise.
    ///
    /// # Errors
    /// When either scene cannot be simulated at a lower voltage.
    pub fn compare(&mut self, other: &Side, other_has_it: bool) -> Result<Vec<Comparison>, SetupError> {
        let Some(current) = &self.current else {
            return Ok(Vec::new());
        };
        let sides = if other_has_it {
            [current, other]
        } else {
            [other, current]
        };
        let all = self.patterns.par_iter().zip(&self.left).enumerate();
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

/// How the displacement differs at the voltage of the scene or, where a solution is lost on the way there, just below; and the work
/// that took.
fn displacement(
    [without, with]: [&Side; 2],
    solutions: [&MeshSolution; 2],
    pattern: &Pattern,
    limit: WorkLimit,
) -> Result<(Option<Displacement>, u64), SetupError> {
    if solutions.iter().all(|solution| solution.outcome.is_converged()) {
        let (before, after) = (without.solver.field(solutions[0]), with.solver.field(solutions[1]));
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
    let mut at = |side: &Side| {
        let scene = side.solver.scene.at_voltage(voltage);
        let solver = MembraneSolver::on_grid(&scene, OPTIONS, side.solver.grid.clone())?;
        let solution = solver.solve_within(pattern, limit);
        work += solution.work;
        Ok(solution.outcome.is_converged().then(|| solver.field(&solution)))
    };
    let (before, after) = (at(without)?, at(with)?);
    let displacement = before
        .zip(after)
        .map(|(before, after)| Displacement::between(&before, &after, voltage));
    Ok((displacement, work))
}
