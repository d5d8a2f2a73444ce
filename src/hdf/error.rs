//! What can go wrong with a file that is read.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::limits::{MEMORY, SECONDS};

/// Why something was not read: what the process that reads says of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Failure {
    /// It is no file that the library opens; its words.
    Unopened(String),
    /// The library could not read it; its words.
    Library(String),
    /// What stands there is not read; why.
    Refused(String),
}

impl From<hdf5::Error> for Failure {
    fn from(error: hdf5::Error) -> Self {
        Self::Library(error.to_string())
    }
}

/// A file that was not read.
#[derive(Debug, thiserror::Error)]
pub enum HdfError {
    /// The library or our own checks refuse it.
    #[error("{path}: {}", self.reason(), path = path.display())]
    Failed {
        /// The file.
        path: PathBuf,
        /// Why.
        failure: Failure,
    },
    /// The process that read it broke down.
    #[error("{path}: {}", self.reason(), path = path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// How the process ended.
        how: String,
    },
    /// The process that read it did not come to an end.
    #[error("{path}: {}", self.reason(), path = path.display())]
    Endless {
        /// The file.
        path: PathBuf,
    },
    /// The system does not let a process start, or talk.
    #[error("cannot start the process that reads {path}: {source}", path = path.display())]
    Process {
        /// The file.
        path: PathBuf,
        /// The system's own message.
        source: io::Error,
    },
    /// A program that uses this library has not named the process that reads files of others.
    #[error("cannot read {path}: no reader process for foreign HDF5 files is set (hdf::set_reader)",
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

    /// What is wrong, without the name of the file.
    #[must_use]
    pub fn reason(&self) -> String {
        match self {
            Self::Failed { failure, .. } => match failure {
                Failure::Unopened(words) => format!("not a readable HDF5 file ({words})"),
                Failure::Library(words) => format!("cannot be read (HDF5: {words})"),
                Failure::Refused(why) => why.clone(),
            },
            Self::Broken { how, .. } => {
                format!("the HDF5 library crashed on this file ({how}); the file is damaged or malicious")
            }
            Self::Endless { .. } => {
                format!("the HDF5 library did not finish within {SECONDS} s; the file is damaged or malicious")
            }
            Self::Process { source, .. } => format!("cannot start the reader process: {source}"),
            Self::NoReader { .. } => "no process is named that reads HDF5 files of others".to_owned(),
        }
    }

    /// Whether the file is to blame, and not the system.
    #[must_use]
    pub fn is_of_the_file(&self) -> bool {
        !matches!(self, Self::Process { .. } | Self::NoReader { .. })
    }
}

/// How a process ended that was to read a file.
pub(super) fn how(status: std::process::ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    match status.signal() {
        Some(signal) => format!("signal {signal}; memory limit {} MiB", MEMORY >> 20),
        None => status.to_string(),
    }
}
