//! Errors in reading HDF5 files.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::limits::{MEMORY, SECONDS};

/// Why a file was not read, as reported by the process that reads it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Failure {
    /// The library cannot open it; with its message, and the error number of the system if that is the cause.
    Unopened(String, Option<i32>),
    /// The library cannot read it; with its message, and the error number of the system if that is the cause.
    Library(String, Option<i32>),
    /// The content is not allowed; with the reason.
    Refused(String),
}

impl From<hdf5::Error> for Failure {
    fn from(error: hdf5::Error) -> Self {
        let number = system_error(&error);
        Self::Library(error.to_string(), number)
    }
}

impl Failure {
    /// Returns the failure of an operation of the system.
    pub(super) fn unopened(error: &io::Error) -> Self {
        Self::Unopened(error.to_string(), error.raw_os_error())
    }

    /// Returns the refusal of a file for an error of the library, unless the system is its cause.
    pub(super) fn refused(error: hdf5::Error, why: impl FnOnce(&hdf5::Error) -> String) -> Self {
        match system_error(&error) {
            Some(_) => error.into(),
            None => Self::Refused(why(&error)),
        }
    }

    /// Returns the error number of the system, if that is the cause.
    #[must_use]
    pub fn system_error(&self) -> Option<i32> {
        match self {
            Self::Unopened(_, number) | Self::Library(_, number) => *number,
            Self::Refused(_) => None,
        }
    }
}

/// Returns the error number of the system that is the cause of an error of the library. It is in the text of one of the
/// frames of its stack, of which the message has only the first and the last. An invalid argument is no such cause:
/// the library takes it from a damaged file.
#[must_use]
pub fn system_error(error: &hdf5::Error) -> Option<i32> {
    let stack = error.stack()?;
    let number = |text: &str| text.split("errno = ").nth(1)?.split(',').next()?.trim().parse().ok();
    let found = stack.iter().find_map(|frame| number(frame.desc()));
    found.filter(|number| io::Error::from_raw_os_error(*number).kind() != io::ErrorKind::InvalidInput)
}

/// The error number of a device that cannot be read (EIO).
const DEVICE_ERROR: i32 = 5;

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
                Failure::Unopened(message, _) => format!("not a readable HDF5 file ({message})"),
                Failure::Library(message, _) => format!("it cannot be read (HDF5: {message})"),
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
        match self {
            Self::Failed { failure, .. } => failure.system_error() != Some(DEVICE_ERROR),
            Self::Broken { .. } | Self::Endless { .. } => true,
            Self::Process { .. } | Self::NoReader { .. } => false,
        }
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
