//! The simulators of one scene, each set up once.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::error::SetupError;
use super::evaluator::Method;
use super::response::{Estimator, LinearResponse};
use super::screening::resolve;
use super::solver::{MembraneSolver, SolveOptions};
use crate::field::{SharedSimulator, SimulatorError, SimulatorKind, Simulators};
use crate::scene::{Effects, Scene};

/// Simulators for a scene.
pub struct SceneSimulators {
    scene: Scene,
    method: Method,
    tolerance: f64,
    ready: Mutex<BTreeMap<SimulatorKind, SharedSimulator>>,
}

impl SceneSimulators {
    /// For a scene, and the method and tolerance of labels. Effects that the scene leaves open are those of the screening,
    /// whatever a dataset says of them. Those that leave the displacement alone are not simulated.
    ///
    /// # Errors
    /// When the effects cannot be simulated.
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
            ready: Mutex::default(),
        })
    }

    fn set_up(&self, kind: SimulatorKind) -> Result<SharedSimulator, SetupError> {
        let (mesh, method, tolerance) = match kind {
            SimulatorKind::AsDeclared(mesh) => (mesh, self.method, self.tolerance),
            SimulatorKind::Newton(mesh) => (mesh, Method::Newton, SolveOptions::default().tolerance),
        };
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
