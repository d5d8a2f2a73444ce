//! Errors in reading HDF5 files.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::limits::{MEMORY, SECONDS};

/// Why a file was not read, as reported by the process that reads it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Failure {
    /// The library cannot open it; with its message.
    Unopened(String),
    /// The library cannot read it; with its message.
    Library(String),
    /// The content is not allowed; with the reason.
    Refused(String),
}

impl From<hdf5::Error> for Failure {
    fn from(error: hdf5::Error) -> Self {
        Self::Library(error.to_string())
    }
}

/// A file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum HdfError {
    /// The library or our own checks refused it.
    #[error("{path}: {}", self.reason(), path = path.display())]
    Failed {
        /// The file.
        path: PathBuf,
        /// The reason.
        failure: Failure,
    },
    /// The process that read it crashed.
    #[error("{path}: {}", self.reason(), path = path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// How the process ended.
        how: String,
    },
    /// The process that read it did not finish.
    #[error("{path}: {}", self.reason(), path = path.display())]
    Endless {
        /// The file.
        path: PathBuf,
    },
    /// The process cannot be started or reached.
    #[error("cannot start the process that reads {path}: {source}", path = path.display())]
    Process {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The program has not set the process that reads untrusted files.
    #[error("cannot read {path}: the program has not set the process that reads untrusted HDF5 files (hdf::set_reader)",
        path = path.display())]
    NoReader {
        /// The file.
        path: PathBuf,
    },
}

impl HdfError {
    pub(super) fn failed(path: &Path, failure: Failure) -> Self {
        Self::Failed {
            path: path.to_owned(),
            failure,
        }
    }

    pub(super) fn refused(path: &Path, why: impl Into<String>) -> Self {
        Self::failed(path, Failure::Refused(why.into()))
    }

    /// Returns what is wrong, without the name of the file.
    #[must_use]
    pub fn reason(&self) -> String {
        match self {
            Self::Failed { failure, .. } => match failure {
                Failure::Unopened(message) => format!("not a readable HDF5 file ({message})"),
                Failure::Library(message) => format!("it cannot be read (HDF5: {message})"),
                Failure::Refused(why) => why.clone(),
            },
            Self::Broken { how, .. } => {
                format!("the HDF5 library crashed while reading it ({how}): the file is damaged or malicious")
            }
            Self::Endless { .. } => {
                format!("the HDF5 library did not finish within {SECONDS} s: the file is damaged or malicious")
            }
            Self::Process { source, .. } => format!("cannot start the process that reads it: {source}"),
            Self::NoReader { .. } => "the process that reads untrusted HDF5 files is not set".to_owned(),
        }
    }

    /// Whether the file is the cause, not the system.
    #[must_use]
    pub fn is_of_the_file(&self) -> bool {
        !matches!(self, Self::Process { .. } | Self::NoReader { .. })
    }
}

/// Describes how a process ended.
pub(super) fn how(status: std::process::ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    match status.signal() {
        Some(signal) => format!("signal {signal}; memory limit {} MiB", MEMORY >> 20),
        None => status.to_string(),
    }
}
