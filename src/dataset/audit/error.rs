//! Errors of an audit.

use std::error::Error;

use deaflow_field::SimulatorError;

/// Error of an audit.
#[derive(Debug, thiserror::Error)]
pub enum AuditError {
    /// Rows cannot be read.
    #[error(transparent)]
    Read(Box<dyn Error + Send + Sync>),
    /// A simulator cannot be set up.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
}

impl AuditError {
    /// Creates an error from an error of reading.
    pub fn read(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Read(cause.into())
    }
}
