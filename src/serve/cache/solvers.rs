//! Solvers that stay set up between two strokes of a pen.

use std::sync::Arc;

use super::kept::Kept;
use crate::http::Refusal;
use deaflow_fem::screening::resolve;
use deaflow_fem::{GradientEvaluator, Method, Solver, SolverParameters};
use deaflow_field::Mesh;
use deaflow_scene::Scene;

/// Solvers that are kept: a slider goes through many voltages.
const KEPT: usize = 12;

/// How a pattern is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// The scene at the voltage, in the state and with the effects that are asked for.
    pub scene: Scene,
    /// The method.
    pub method: Method,
    /// The mesh.
    pub mesh: Mesh,
}

/// Where a pattern loses stability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Critical {
    /// The critical voltage, V, by two meshes; by that of the setting alone where `error` is none.
    pub voltage: f64,
    /// How far the truth may lie on either side, V.
    pub error: Option<f64>,
    /// The voltages between which the mesh of the setting loses it, V.
    pub bracket: [f64; 2],
}

/// A solver with its scene.
pub struct Bench {
    /// The scene with its effects decided.
    pub scene: Scene,
    /// The solver.
    pub solver: Solver,
}

/// Those that were used last.
pub struct Benches {
    solvers: Kept<Setting, Bench>,
    gradients: Kept<Scene, GradientEvaluator>,
}

impl Default for Benches {
    fn default() -> Self {
        Self {
            solvers: Kept::new(KEPT),
            gradients: Kept::new(KEPT),
        }
    }
}

impl Benches {
    /// The solver of a setting.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn solver(&self, setting: &Setting) -> Result<Arc<Bench>, Refusal> {
        if let Some(known) = self.solvers.get(setting) {
            return Ok(known);
        }
        let scene = resolve(&setting.scene)?;
        let bench = Arc::new(Bench {
            solver: SolverParameters::new(setting.method, setting.mesh).build(&scene)?,
            scene,
        });
        self.solvers.put(setting.clone(), &bench);
        Ok(bench)
    }

    /// Newton's method on a finer mesh, by which the error of a setting is told; `None` on the finest.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn finer(&self, setting: &Setting) -> Result<Option<Arc<Bench>>, Refusal> {
        let finer = |mesh: Mesh| Setting {
            method: Method::Newton,
            mesh,
            ..setting.clone()
        };
        setting.mesh.finer().map(|mesh| self.solver(&finer(mesh))).transpose()
    }

    /// What says how a field changes with the pattern.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn gradient(&self, scene: &Scene) -> Result<Arc<GradientEvaluator>, Refusal> {
        if let Some(known) = self.gradients.get(scene) {
            return Ok(known);
        }
        let evaluator = Arc::new(GradientEvaluator::new(&resolve(scene)?)?);
        self.gradients.put(scene.clone(), &evaluator);
        Ok(evaluator)
    }
}
