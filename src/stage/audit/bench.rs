//! The simulators that an audit asks for, each set up once.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::dataset::audit::{Bench, Mesh, Ready, Wanted};
use crate::fem::effects::screening::resolve;
use crate::fem::{LinearResponse, MembraneSolver, Order, SetupError, SolveOptions};
use crate::field::{Simulation, Simulator};
use crate::pattern::Pattern;
use crate::scene::{Effects, Scene};
use crate::stage::method::Method;
use crate::stage::solver::explained;

/// Simulators for a scene.
pub struct Workbench {
    scene: Scene,
    method: Method,
    tolerance: f64,
    ready: Mutex<BTreeMap<Wanted, Ready>>,
}

impl Workbench {
    /// For a scene, and the method and tolerance that the dataset declares. Effects that the scene leaves open are
    /// decided as [`decided`] says. Those that leave the displacement alone are not simulated.
    ///
    /// # Errors
    /// When the effects cannot be simulated.
    pub fn new(scene: &Scene, effects: Option<&str>, method: Method, tolerance: f64) -> Result<Self, SetupError> {
        let scene = decided(scene, effects)?;
        let effects = Effects {
            dielectric_breakdown: None,
            electromechanical_stability: false,
            ..scene.effects.clone()
        };
        Ok(Self {
            scene: scene.with_effects(effects),
            method,
            tolerance,
            ready: Mutex::default(),
        })
    }

    fn set_up(&self, wanted: Wanted) -> Result<Ready, SetupError> {
        let (mesh, method, tolerance) = match wanted {
            Wanted::Own(mesh) => (mesh, self.method, self.tolerance),
            Wanted::Newton(mesh) => (mesh, Method::Newton, crate::fem::SolveOptions::default().tolerance),
        };
        let options = options(mesh, tolerance);
        Ok(match method.chord_steps() {
            None => Arc::new(MembraneSolver::new(&self.scene, options)?),
            Some(steps) => Arc::new(Estimator(LinearResponse::new(&self.scene, options)?, steps)),
        })
    }
}

fn options(mesh: Mesh, tolerance: f64) -> SolveOptions {
    SolveOptions {
        elements_per_cell: mesh.elements_per_cell as usize,
        order: if mesh.order == 2 {
            Order::Biquadratic
        } else {
            Order::Bilinear
        },
        tolerance,
    }
}

impl Bench for Workbench {
    fn simulator(&self, wanted: Wanted) -> Result<Ready, String> {
        let mut ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(simulator) = ready.get(&wanted) {
            return Ok(Arc::clone(simulator));
        }
        let simulator = self.set_up(wanted).map_err(|e| explained(&e))?;
        ready.insert(wanted, Arc::clone(&simulator));
        Ok(simulator)
    }
}

/// A scene whose effects are decided. Those that it leaves open are `effects` or, without that, those of the screening.
///
/// # Errors
/// When the effects cannot be simulated.
pub fn decided(scene: &Scene, effects: Option<&str>) -> Result<Scene, SetupError> {
    let known = || {
        let text = scene.to_text();
        Scene::from_text(&text.replace("effects: auto", &format!("effects: {}", effects?))).ok()
    };
    match scene.auto.then(known).flatten() {
        Some(scene) => Ok(scene),
        None => resolve(scene),
    }
}

/// The linear response and so many chord steps.
struct Estimator(LinearResponse, u32);

impl Simulator for Estimator {
    fn simulate(&self, patterns: &[Pattern]) -> Vec<Simulation> {
        self.0.simulate(patterns, self.1)
    }
}
