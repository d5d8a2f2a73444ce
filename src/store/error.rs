//! Errors of the store, each with the path and, where possible, what to do about it.

use std::io;
use std::path::{Path, PathBuf};

use super::object::ObjectError;
use deaflow_base::{ArtifactId, EncodingError, InputError, OutputError};
use deaflow_hdf::HdfError;

/// An operation on the store failed.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The operating system reported an error.
    #[error("cannot {action} {path}: {source}", path = path.display())]
    Io {
        /// The operation, as a verb ("write", "open").
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The HDF5 library reported an error.
    #[error("cannot {action} {path}: HDF5: {message}", path = path.display())]
    Hdf5 {
        /// The operation, as a verb.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The message of the library.
        message: String,
    },
    /// A file that the user named cannot be read.
    #[error(transparent)]
    Hdf(#[from] HdfError),
    /// The store has a format version that this program does not support.
    #[error("the store format in {path} is {found:?}, supported is `{known}`: use the version of \
             deaflow that made the store, or another --store",
        path = path.display())]
    Format {
        /// The marker file.
        path: PathBuf,
        /// The format that it names.
        found: String,
        /// The format that this program supports.
        known: &'static str,
    },
    /// The marker file of the store is damaged or missing.
    #[error("{path} is damaged: {reason}", path = path.display())]
    Marker {
        /// The marker file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A path of the store is not the folder or file that belongs there.
    #[error("{path} is {found}, but the store needs {wanted} there: move it away, or name another --store; nothing \
             was changed",
        path = path.display())]
    Foreign {
        /// The path.
        path: PathBuf,
        /// The kind of file that was found.
        found: &'static str,
        /// The kind of file that belongs there.
        wanted: &'static str,
    },
    /// The path is not a folder, or a folder with other files.
    #[error("{path} is not an artifact store: name an empty or a new folder", path = path.display())]
    NotAStore {
        /// The folder.
        path: PathBuf,
    },
    /// The path of the folder is not UTF-8, which HDF5 requires.
    #[error("the path of the store {path} is not UTF-8, so HDF5 cannot open files there: rename the folder, or name \
             another --store",
        path = path.display())]
    PathNotUtf8 {
        /// The folder.
        path: PathBuf,
    },
    /// The folder is not a store, and none may be created.
    #[error("there is no artifact store at {path}: name one with --store", path = path.display())]
    NoStore {
        /// The folder.
        path: PathBuf,
    },
    /// The operation needs exclusive access, and another process uses the store.
    #[error("the store {path} is in use by {who}: wait until it has finished", path = path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
        /// The processes that use it.
        who: String,
    },
    /// The artifact is not in the store.
    #[error("artifact {digest} is missing: {path} does not exist", digest = digest.short(), path = path.display())]
    Missing {
        /// The artifact.
        digest: ArtifactId,
        /// The path of its file.
        path: PathBuf,
    },
    /// The content of a file differs from what was written.
    #[error("{path} is damaged: {reason}", path = path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The artifact has no dataset of that path.
    #[error("artifact {digest} has no dataset `{dataset}`; available: {known}", digest = digest.short())]
    NoDataset {
        /// The artifact.
        digest: ArtifactId,
        /// The requested dataset.
        dataset: String,
        /// The datasets of the artifact.
        known: String,
    },
    /// The dataset has another element type than requested.
    #[error("dataset `{dataset}` of artifact {digest} has type {found}, expected {expected}", digest = digest.short())]
    WrongType {
        /// The artifact.
        digest: ArtifactId,
        /// The dataset.
        dataset: String,
        /// The requested type.
        expected: &'static str,
        /// The actual type.
        found: &'static str,
    },
    /// A lock file exists but cannot be used.
    #[error("cannot use the lock file {path}: {source}", path = path.display())]
    LockFile {
        /// The lock file.
        path: PathBuf,
        /// What is wrong with it.
        source: InputError,
    },
    /// An artifact that a pin or a lock file needs is missing, so its further dependencies are unknown.
    #[error("{root} needs artifact {missing}, which is missing: nothing was removed", missing = missing.short())]
    Unreachable {
        /// The pin or lock file.
        root: String,
        /// The missing artifact.
        missing: ArtifactId,
    },
    /// An artifact from which another one was made is missing.
    #[error("artifact {digest} was made from artifact {missing}, which is missing",
        digest = digest.short(), missing = missing.short())]
    IncompleteInputs {
        /// The artifact.
        digest: ArtifactId,
        /// The missing artifact.
        missing: ArtifactId,
    },
    /// The chunks of a manifest cannot be concatenated.
    #[error("chunk {digest} does not match the first chunk: {reason}", digest = digest.short())]
    Parts {
        /// The chunk that differs.
        digest: ArtifactId,
        /// The difference.
        reason: String,
    },
    /// The artifact does not have the content of its kind.
    #[error("artifact {digest}: {source}", digest = digest.short())]
    Content {
        /// The artifact.
        digest: ArtifactId,
        /// What is wrong with it.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// An output file that the user named cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The content is not valid for an artifact.
    #[error(transparent)]
    Object(#[from] ObjectError),
    /// A value cannot be written as JSON.
    #[error("cannot write as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// A record or key cannot be encoded.
    #[error(transparent)]
    Encoding(#[from] EncodingError),
}

/// Returns the error number of the system that a message of HDF5 or of the standard library contains.
fn errno(message: &str) -> Option<i32> {
    let after = |mark: &str, end: char| message.split(mark).nth(1)?.split(end).next()?.trim().parse().ok();
    after("errno = ", ',').or_else(|| after("(os error ", ')'))
}

/// Returns an out-of-memory error if HDF5 reports one: the file itself may be intact.
fn out_of_memory(message: &str) -> Option<io::Error> {
    let contains = |text: &&str| message.contains(*text);
    let short = ["memory allocation failed", "No space available for allocation"];
    short.iter().any(contains).then(|| io::ErrorKind::OutOfMemory.into())
}

impl StoreError {
    /// Whether a file of the store is missing or damaged, so that `fsck` and a rebuild are needed.
    #[must_use]
    pub fn is_damage(&self) -> bool {
        matches!(self, Self::Missing { .. } | Self::Damaged { .. })
    }

    /// Whether the operation may succeed later or on another machine: the system reported an error, a damaged file can
    /// be rebuilt, or another process was using the store.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        matches!(self, Self::Io { .. } | Self::Hdf5 { .. } | Self::Busy { .. }) || self.is_damage()
    }

    /// Returns a function for `map_err` on results of the standard library.
    pub(super) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// Returns a function for `map_err` on results of the HDF5 library.
    pub(super) fn hdf5(action: &'static str, path: &Path) -> impl Fn(hdf5::Error) -> Self {
        let path = path.to_owned();
        move |error| match deaflow_hdf::system_error(&error) {
            Some(number) => Self::io(action, &path)(io::Error::from_raw_os_error(number)),
            None => Self::from_hdf5_message(action, &path, error.to_string()),
        }
    }

    /// Whether a message of the HDF5 library reports an error of the system.
    pub(super) fn is_system_error(message: &str) -> bool {
        errno(message).is_some() || out_of_memory(message).is_some()
    }

    /// Returns the error for a message of the HDF5 library.
    pub(super) fn from_hdf5_message(action: &'static str, path: &Path, message: String) -> Self {
        let path = path.to_owned();
        let system = errno(&message).map(io::Error::from_raw_os_error);
        match system.or_else(|| out_of_memory(&message)) {
            Some(source) => Self::Io { action, path, source },
            None => Self::Hdf5 { action, path, message },
        }
    }

    pub(super) fn damaged(path: &Path, reason: impl Into<String>) -> Self {
        Self::Damaged {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }
}
