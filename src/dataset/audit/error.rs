//! Why an audit could not be carried out.

use std::error::Error;

use deaflow_field::SimulatorError;

/// An audit that could not be carried out.
#[derive(Debug, thiserror::Error)]
pub enum AuditError {
    /// Rows that cannot be read.
    #[error(transparent)]
    Read(Box<dyn Error + Send + Sync>),
    /// A simulator that cannot be set up.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
}

impl AuditError {
    /// From what reading reported.
    pub fn read(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Read(cause.into())
    }
}
