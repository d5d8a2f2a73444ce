//! Creates simulators of one scene on any mesh.

use std::error::Error;
use std::sync::Arc;

use super::mesh::Mesh;
use super::simulate::Simulator;

/// The kind of simulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimulatorKind {
    /// The method of a dataset, on this mesh.
    AsDeclared(Mesh),
    /// Newton's method on this mesh.
    Newton(Mesh),
}

/// A shared simulator.
pub type SharedSimulator = Arc<dyn Simulator + Send>;

/// Why a simulator cannot be set up.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct SimulatorError(Box<dyn Error + Send + Sync>);

impl SimulatorError {
    /// Creates an error from that of the solver.
    pub fn new(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self(cause.into())
    }
}

/// Creates simulators of one scene.
pub trait Simulators: Sync {
    /// Creates a simulator.
    ///
    /// # Errors
    /// When it cannot be set up.
    fn simulator(&self, kind: SimulatorKind) -> Result<SharedSimulator, SimulatorError>;
}
