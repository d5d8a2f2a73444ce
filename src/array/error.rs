//! Errors of array files.

use std::io;

use deaflow_base::NpyError;
use deaflow_hdf::{Failure, HdfError};

/// What a file that cannot be read most likely needs.
const DAMAGED: &str = "the file is truncated or damaged; write it again";

/// Why an array cannot be read, and what would help.
#[derive(Debug, thiserror::Error)]
#[error("{why}")]
pub struct ArrayError {
    why: String,
    help: String,
}

impl ArrayError {
    pub(super) fn new(why: impl Into<String>, help: impl Into<String>) -> Self {
        let (why, help) = (why.into(), help.into());
        Self { why, help }
    }

    pub(super) fn damaged(why: impl Into<String>) -> Self {
        Self::new(why, DAMAGED)
    }

    /// Puts the name of an array before the message.
    pub(super) fn of(self, name: &str) -> Self {
        match name {
            "" => self,
            _ => Self {
                why: format!("`{name}`: {}", self.why),
                ..self
            },
        }
    }

    /// Returns what would help.
    #[must_use]
    pub fn help(&self) -> &str {
        &self.help
    }
}

impl From<io::Error> for ArrayError {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
                Self::damaged(error.to_string())
            }
            _ => Self::new(error.to_string(), "check the name of the file and its permissions"),
        }
    }
}

impl From<NpyError> for ArrayError {
    fn from(error: NpyError) -> Self {
        Self::new(error.to_string(), error.help().unwrap_or(DAMAGED))
    }
}

impl From<HdfError> for ArrayError {
    fn from(error: HdfError) -> Self {
        let help = match &error {
            HdfError::Failed {
                failure: Failure::Refused(why),
                ..
            } if why.contains("compressed with") => "write it with gzip or without compression",
            HdfError::Failed {
                failure: Failure::Refused(_),
                ..
            } => "copy the dataset itself into the file, for example with h5py",
            HdfError::Process { .. } | HdfError::NoReader { .. } => "this is not the fault of the file",
            HdfError::Failed { .. } | HdfError::Broken { .. } | HdfError::Endless { .. } => DAMAGED,
        };
        Self::new(error.reason(), help)
    }
}
