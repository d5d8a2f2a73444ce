//! Where solutions with an effect are compared with solutions without it, within the work that each pattern is allowed.

use rayon::prelude::*;

use super::comparison::{Comparison, Displacement};
use super::trial::Trial;
use crate::fem::{MembraneSolver, MeshSolution, SetupError, SolveOptions, WorkLimit};
use crate::field::Mesh;
use crate::pattern::Pattern;
use crate::scene::Scene;

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

/// The mesh and tolerance of solutions that are compared.
fn on(mesh: Mesh) -> SolveOptions {
    SolveOptions { mesh, tolerance: 1e-7 }
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

    /// Solves for all patterns in a scene.
    ///
    /// # Errors
    /// When the scene cannot be simulated.
    pub fn solve(&mut self, scene: &Scene, mesh: Mesh) -> Result<Side, SetupError> {
        let solver = MembraneSolver::new(scene, on(mesh))?;
        let work = self.patterns.par_iter().zip(&self.left);
        let solutions: Vec<MeshSolution> = work
            .map(|((_, pattern), left)| solver.solve_within(pattern, self.each.min(*left)))
            .collect();
        for (left, solution) in self.left.iter_mut().zip(&solutions) {
            *left = left.less(solution.work);
        }
        Ok(Side { solver, solutions })
    }

    /// Sees to it that the solutions of the scene as it stands are known on a mesh.
    ///
    /// # Errors
    /// When the scene cannot be simulated.
    pub fn prepare(&mut self, scene: &Scene, mesh: Mesh) -> Result<(), SetupError> {
        if self.current.as_ref().is_none_or(|side| side.solver.mesh() != mesh) {
            self.current = Some(self.solve(scene, mesh)?);
        }
        Ok(())
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
    let fields = [without.solver.field(solutions[0]), with.solver.field(solutions[1])];
    let [before, after] = &fields;
    let scene = without.solver.scene();
    if solutions.iter().all(|solution| solution.outcome.is_converged()) {
        return Ok((Some(Displacement::between(before, after, scene.voltage_v())), 0));
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
        let solver = MembraneSolver::new(&side.solver.scene().at_voltage(voltage), on(side.solver.mesh()))?;
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
