//! Margins from pull-in and breakdown, computed by simulation.

use rayon::prelude::*;

use super::effects::breakdown_strength;
use super::{CriticalSearch, MembraneSolver, SetupError, SolveOptions, SpatialSolver};
use deaflow_field::{Feasibility, Mesh, PredictError, Simulator};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Checks the margins of patterns.
pub struct SafetyMargins {
    pull_in: Option<Stability>,
    /// Solver for the breakdown ratio, and the largest allowed ratio.
    breakdown: Option<(Box<dyn Simulator + Send>, f64)>,
}

/// At the voltage times the margin every pattern must be stable.
enum Stability {
    /// On any mesh.
    InPlane(Box<CriticalSearch>),
    /// On the mesh of the search.
    InSpace(Box<SpatialSolver>),
}

impl SafetyMargins {
    /// Creates the check for a scene with decided effects: voltages of pull-in and breakdown must be at least these
    /// multiples of the voltage, if given. `None` without any.
    ///
    /// # Errors
    /// If the scene cannot be simulated.
    pub fn new(scene: &Scene, pull_in: Option<f64>, breakdown: Option<f64>) -> Result<Option<Self>, SetupError> {
        let options = SolveOptions::on(Mesh::biquadratic(1));
        let pull_in = pull_in.map(|margin| {
            let driven = scene.at_voltage(scene.voltage_v() * margin);
            Ok(match driven.is_in_space() {
                true => Stability::InSpace(Box::new(SpatialSolver::new(&driven, options)?)),
                false => Stability::InPlane(Box::new(CriticalSearch::new(&driven, options)?)),
            })
        });
        let breakdown = breakdown.map(|margin| {
            let mut effects = scene.effects.clone();
            effects.dielectric_breakdown = breakdown_strength(scene);
            let observed = scene.with_effects(effects);
            let solver: Box<dyn Simulator + Send> = match observed.is_in_space() {
                true => Box::new(SpatialSolver::new(&observed, options)?),
                false => Box::new(MembraneSolver::new(&observed, options)?),
            };
            Ok((solver, 1.0 / margin))
        });
        let margins = Self {
            pull_in: pull_in.transpose()?,
            breakdown: breakdown.transpose()?,
        };
        Ok((margins.pull_in.is_some() || margins.breakdown.is_some()).then_some(margins))
    }
}

impl Feasibility for SafetyMargins {
    fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
        let mut verdicts = vec![true; patterns.len()];
        match &self.pull_in {
            None => {}
            Some(Stability::InPlane(search)) => {
                let each = patterns.par_iter();
                verdicts = each.map(|pattern| search.is_certainly_stable(pattern)).collect();
            }
            Some(Stability::InSpace(solver)) => {
                let results = solver.simulate(patterns).into_iter();
                verdicts = results.map(|result| result.outcome.is_converged()).collect();
            }
        }
        if let Some((solver, most)) = &self.breakdown {
            for (verdict, result) in verdicts.iter_mut().zip(solver.simulate(patterns)) {
                let ratio = result.observation.breakdown_ratio;
                *verdict &= ratio.is_some_and(|ratio| ratio <= *most);
            }
        }
        Ok(verdicts)
    }
}
