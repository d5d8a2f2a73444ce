//! Simulators of one scene on any mesh.

use std::error::Error;
use std::sync::Arc;

use super::mesh::Mesh;
use super::simulate::Simulator;

/// The kind of simulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimulatorKind {
    /// The method that a dataset declares, on this mesh.
    AsDeclared(Mesh),
    /// Newton's method on this mesh.
    Newton(Mesh),
}

/// A simulator that is set up.
pub type SharedSimulator = Arc<dyn Simulator + Send>;

/// A simulator that cannot be set up.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct SimulatorError(Box<dyn Error + Send + Sync>);

impl SimulatorError {
    /// From what setting up reported.
    pub fn new(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self(cause.into())
    }
}

/// Gives simulators, ready for one scene.
pub trait Simulators: Sync {
    /// A simulator.
    ///
    /// # Errors
    /// When it cannot be set up.
    fn simulator(&self, kind: SimulatorKind) -> Result<SharedSimulator, SimulatorError>;
}
