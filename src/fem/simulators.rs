//! The simulators of one scene, each created once.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::error::SetupError;
use super::evaluator::{Method, SolverParameters, last_state};
use super::response::{Estimator, LinearResponse};
use super::screening::resolve;
use super::solver::{MembraneSolver, SolveOptions};
use super::time::{HistoryOptions, HistoryRequest, HistorySolver, history_check};
use deaflow_field::{
    Observation, Outcome, SharedSimulator, Simulation, Simulator, SimulatorError, SimulatorKind, Simulators,
};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

/// Simulators for a scene.
pub struct SceneSimulators {
    scene: Scene,
    method: Method,
    tolerance: f64,
    /// The request of a history whose last displacement is the result.
    history: Option<HistoryRequest>,
    ready: Mutex<BTreeMap<SimulatorKind, SharedSimulator>>,
}

impl SceneSimulators {
    /// Creates simulators for a scene, with the method and tolerance of labels. Screening decides effects that the
    /// scene leaves open. Effects that do not change the displacement are left out.
    ///
    /// # Errors
    /// If the effects cannot be simulated.
    pub fn new(scene: &Scene, method: Method, tolerance: f64) -> Result<Self, SetupError> {
        let scene = resolve(scene)?;
        let effects = Effects {
            dielectric_breakdown: None,
            electromechanical_stability: None,
            ..scene.effects.clone()
        };
        Ok(Self {
            scene: scene.with_effects(effects),
            method,
            tolerance,
            history: None,
            ready: Mutex::default(),
        })
    }

    /// Simulates the drive in time if `solver` does.
    #[must_use]
    pub fn through(self, solver: &SolverParameters) -> Self {
        Self {
            history: solver.history_request(),
            ..self
        }
    }

    fn set_up(&self, kind: SimulatorKind) -> Result<SharedSimulator, SetupError> {
        let (mesh, method, tolerance) = match kind {
            SimulatorKind::AsDeclared(mesh) => (mesh, self.method, self.tolerance),
            SimulatorKind::Newton(mesh) => (mesh, Method::Newton, SolveOptions::default().tolerance),
        };
        if let Some(request) = &self.history {
            let options = HistoryOptions {
                mesh: Some(mesh),
                tolerance,
            };
            history_check(&self.scene)?;
            return Ok(Arc::new(HistorySolver::new(&self.scene, &options, request.clone())?));
        }
        Ok(match method.chord_steps() {
            None => Arc::new(MembraneSolver::new(&self.scene, SolveOptions { mesh, tolerance })?),
            Some(chord_steps) => Arc::new(Estimator {
                response: LinearResponse::new(&self.scene, mesh)?,
                chord_steps,
            }),
        })
    }
}

impl Simulators for SceneSimulators {
    fn simulator(&self, kind: SimulatorKind) -> Result<SharedSimulator, SimulatorError> {
        let mut ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(simulator) = ready.get(&kind) {
            return Ok(Arc::clone(simulator));
        }
        let simulator = self.set_up(kind).map_err(SimulatorError::new)?;
        ready.insert(kind, Arc::clone(&simulator));
        Ok(simulator)
    }
}

impl Simulator for HistorySolver {
    /// Returns the states at the end.
    fn simulate(&self, patterns: &[Pattern]) -> Vec<Simulation> {
        let each = patterns.par_iter().map(|pattern| match self.displace(pattern) {
            Ok(found) => last_state(&found).simulation,
            // A drive with too many steps, which no other solver simulates either.
            Err(_) => Simulation {
                outcome: Outcome::WorkLimit,
                field: None,
                newton_iterations: 0,
                residual: 0.0,
                observation: Observation::default(),
            },
        });
        each.collect()
    }
}
