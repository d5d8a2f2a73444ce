//! Solvers that are kept ready between two strokes of the pen.

use std::sync::Arc;

use super::lru::LruCache;
use crate::http::ApiError;
use deaflow_fem::screening::resolve;
use deaflow_fem::{GradientEvaluator, Method, Solver, SolverParameters};
use deaflow_field::Mesh;
use deaflow_scene::Scene;

/// Number of solvers kept: the voltage slider needs one for each voltage.
const MAX_SOLVERS: usize = 12;

/// Scene, method and mesh of a simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulationSetup {
    /// The scene with the requested voltage, state and effects.
    pub scene: Scene,
    /// The method.
    pub method: Method,
    /// The mesh.
    pub mesh: Mesh,
}

/// The voltage at which a pattern loses stability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalVoltage {
    /// The critical voltage, V: from two meshes, or from the mesh of the request if `error` is `None`.
    pub voltage: f64,
    /// Half the width of the error interval, V.
    pub error: Option<f64>,
    /// The last stable and the first unstable voltage on the mesh of the request, V.
    pub bracket: [f64; 2],
}

/// What limits the voltage of a pattern before it loses stability, on the mesh of the request; `None` if it is not
/// reached, or not known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VoltageLimits {
    /// The voltage at which the electric field reaches the breakdown field of the scene, V.
    pub breakdown: Option<f64>,
    /// The voltage from which the membrane wrinkles, V.
    pub wrinkling: Option<f64>,
}

/// A solver with its scene.
pub struct PreparedSolver {
    /// The scene with its effects resolved.
    pub scene: Scene,
    /// The solver.
    pub solver: Solver,
}

impl PreparedSolver {
    /// Creates the solver of a setup.
    ///
    /// # Errors
    /// If it cannot be set up.
    pub fn new(setup: &SimulationSetup) -> Result<Self, ApiError> {
        let scene = resolve(&setup.scene)?;
        let solver = SolverParameters::new(setup.method, setup.mesh).build(&scene)?;
        Ok(Self { scene, solver })
    }
}

/// The most recently used solvers.
pub struct SolverCache {
    solvers: LruCache<SimulationSetup, PreparedSolver>,
    gradients: LruCache<Scene, GradientEvaluator>,
}

impl Default for SolverCache {
    fn default() -> Self {
        Self {
            solvers: LruCache::new(MAX_SOLVERS),
            gradients: LruCache::new(MAX_SOLVERS),
        }
    }
}

impl SolverCache {
    /// Returns the solver of a setup.
    ///
    /// # Errors
    /// If it cannot be set up.
    pub fn solver(&self, setup: &SimulationSetup) -> Result<Arc<PreparedSolver>, ApiError> {
        self.solvers.get_or_insert(setup, || PreparedSolver::new(setup))
    }

    /// Returns Newton's method on a finer mesh, which estimates the error of a setup; `None` on the finest mesh.
    ///
    /// # Errors
    /// If it cannot be set up.
    pub fn finer(&self, setup: &SimulationSetup) -> Result<Option<Arc<PreparedSolver>>, ApiError> {
        let finer = |mesh: Mesh| SimulationSetup {
            method: Method::Newton,
            mesh,
            ..setup.clone()
        };
        setup.mesh.finer().map(|mesh| self.solver(&finer(mesh))).transpose()
    }

    /// Returns the evaluator of gradients with respect to the pattern.
    ///
    /// # Errors
    /// If it cannot be set up.
    pub fn gradient(&self, scene: &Scene) -> Result<Arc<GradientEvaluator>, ApiError> {
        self.gradients
            .get_or_insert(scene, || Ok(GradientEvaluator::new(&resolve(scene)?)?))
    }
}
