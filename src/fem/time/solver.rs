//! The solver of histories that parameters give: on one mesh, or on the mesh that each pattern needs.

use super::accurate::AccurateHistory;
use super::history::HistoryRequest;
use crate::fem::accurate::AccurateSolver;
use crate::fem::error::SetupError;
use crate::fem::solver::{MembraneSolver, SolveOptions};
use crate::field::Mesh;
use crate::pattern::Pattern;
use crate::scene::Scene;

/// How histories are solved.
#[derive(Clone, Debug, PartialEq)]
pub struct HistoryOptions {
    /// The mesh of all patterns; none where each has the one that reaches the accuracy of the request.
    pub mesh: Option<Mesh>,
    /// Relative residual of equilibria.
    pub tolerance: f64,
}

/// A solver of histories that is ready for the patterns of a scene.
pub struct HistorySolver {
    engine: Engine,
    request: HistoryRequest,
}

enum Engine {
    Fixed(Box<MembraneSolver>, Mesh),
    Accurate(Box<AccurateSolver>),
}

impl HistorySolver {
    /// The solver of a scene whose effects are decided.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn new(scene: &Scene, options: &HistoryOptions, request: HistoryRequest) -> Result<Self, SetupError> {
        let HistoryOptions { mesh, tolerance } = *options;
        let engine = match mesh {
            None => {
                let accuracy = request.accuracy_mm.unwrap_or(f64::NAN);
                Engine::Accurate(Box::new(AccurateSolver::new(scene, accuracy, tolerance)?))
            }
            Some(mesh) => {
                let solver = MembraneSolver::new(scene, SolveOptions { mesh, tolerance })?;
                Engine::Fixed(Box::new(solver), mesh)
            }
        };
        Ok(Self { engine, request })
    }

    /// The times at which fields are wanted, in s.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.request.times
    }

    /// How a pattern moves in the time of the drive.
    ///
    /// # Errors
    /// When a finer mesh cannot be set up, or as [`MembraneSolver::history`].
    pub fn follow(&self, pattern: &Pattern) -> Result<AccurateHistory, SetupError> {
        match &self.engine {
            Engine::Fixed(solver, mesh) => Ok(AccurateHistory {
                history: solver.history(pattern, &self.request)?,
                mesh: *mesh,
                space_error_mm: None,
            }),
            Engine::Accurate(solver) => solver.history(pattern, &self.request),
        }
    }
}
