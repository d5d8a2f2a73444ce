//! What can go wrong in a store, each with the place and what to do about it.

use std::io;
use std::path::{Path, PathBuf};

use super::object::ObjectError;
use deaflow_base::{ArtifactId, EncodingError, OutputError};
use deaflow_hdf::HdfError;

/// A refusal by the store.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The operating system refused.
    #[error("cannot {action} {path}: {source}", path = path.display())]
    Io {
        /// What was tried ("write", "open").
        action: &'static str,
        /// On which file or folder.
        path: PathBuf,
        /// The system's own message.
        source: io::Error,
    },
    /// The HDF5 library refused.
    #[error("cannot {action} {path}: HDF5: {message}", path = path.display())]
    Hdf5 {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// The library's own message.
        message: String,
    },
    /// A file that somebody has named cannot be read.
    #[error(transparent)]
    Hdf(#[from] HdfError),
    /// The store was written by another version of the layout.
    #[error("{path} says {found:?}; this program knows `{known}`: use the program that made the store, or another --store",
        path = path.display())]
    Format {
        /// The marker file.
        path: PathBuf,
        /// What it says.
        found: String,
        /// What it should say.
        known: &'static str,
    },
    /// The marker of the store is not what was written.
    #[error("{path} is damaged: {reason}", path = path.display())]
    Marker {
        /// The marker file.
        path: PathBuf,
        /// How that shows.
        reason: String,
    },
    /// Something else stands in the place of a folder or a lock of the store.
    #[error("{path} is {found} and not {wanted} of the store: move it away, or name another --store; nothing was touched",
        path = path.display())]
    Foreign {
        /// Where it stands.
        path: PathBuf,
        /// What it is.
        found: &'static str,
        /// What it should be.
        wanted: &'static str,
    },
    /// A folder that holds something else, or no folder.
    #[error("{path} holds something else than an artifact store: name an empty or a new folder with --store", path = path.display())]
    NotAStore {
        /// The folder.
        path: PathBuf,
    },
    /// A folder whose path HDF5 cannot be given.
    #[error("the path of the store {path} is not UTF-8: HDF5 cannot open files there", path = path.display())]
    PathNotUtf8 {
        /// The folder.
        path: PathBuf,
    },
    /// A folder that is no store, where one is to be read.
    #[error("there is no artifact store at {path}: name one with --store", path = path.display())]
    NoStore {
        /// The folder.
        path: PathBuf,
    },
    /// Another process works in a store that has to be held alone.
    #[error("{who} works in {path}: wait until that has ended", path = path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
        /// Who works there.
        who: String,
    },
    /// The artifact is not in the store.
    #[error("artifact {digest} is missing: no {path}", digest = digest.short(), path = path.display())]
    Missing {
        /// Which artifact.
        digest: ArtifactId,
        /// Where it should be.
        path: PathBuf,
    },
    /// A file that is not what it was when it was written.
    #[error("{path} is damaged: {reason}", path = path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// How that shows.
        reason: String,
    },
    /// The artifact has no such dataset.
    #[error("artifact {digest} has no dataset `{dataset}`; it has: {known}", digest = digest.short())]
    NoDataset {
        /// Which artifact.
        digest: ArtifactId,
        /// The wanted dataset.
        dataset: String,
        /// The datasets that it has.
        known: String,
    },
    /// The dataset has elements of another type.
    #[error("dataset `{dataset}` of artifact {digest} holds {found}, not {wanted}", digest = digest.short())]
    WrongType {
        /// Which artifact.
        digest: ArtifactId,
        /// Which dataset.
        dataset: String,
        /// The type that was asked for.
        wanted: &'static str,
        /// The type that it has.
        found: &'static str,
    },
    /// A lock file that is there and cannot be used.
    #[error("the lock file {path} cannot be used: {reason}", path = path.display())]
    LockFile {
        /// The lock file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// Something that a pin or a lock file needs is not there, so that it is not known what else it needs.
    #[error("{root} needs artifact {missing}, which is missing: nothing is removed", missing = missing.short())]
    Unreachable {
        /// The pin or lock file.
        root: String,
        /// What is missing.
        missing: ArtifactId,
    },
    /// Something that an artifact was made from is not there.
    #[error("what artifact {digest} was made from is not all here: {missing} is missing", digest = digest.short(), missing = missing.short())]
    NotWhole {
        /// Which artifact.
        digest: ArtifactId,
        /// What is missing.
        missing: ArtifactId,
    },
    /// Chunks that do not fit together.
    #[error("chunk {digest} does not fit the first chunk: {reason}", digest = digest.short())]
    Parts {
        /// The chunk that differs.
        digest: ArtifactId,
        /// How.
        reason: String,
    },
    /// A file that was asked for by name cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Content that cannot be an artifact.
    #[error(transparent)]
    Object(#[from] ObjectError),
    /// The file of a run that cannot be written as JSON.
    #[error("cannot describe the run: {0}")]
    Json(String),
    /// A record or key that cannot be encoded.
    #[error(transparent)]
    Encoding(#[from] EncodingError),
}

/// The number of the system's refusal, where HDF5 reports one among addresses and counters, or the standard library in its words.
fn errno(message: &str) -> Option<i32> {
    let after = |mark: &str, end: char| message.split(mark).nth(1)?.split(end).next()?.trim().parse().ok();
    after("errno = ", ',').or_else(|| after("(os error ", ')'))
}

/// Where HDF5 had no memory: that says nothing of the file.
fn out_of_memory(message: &str) -> Option<io::Error> {
    let says = |words: &&str| message.contains(*words);
    let short = ["memory allocation failed", "No space available for allocation"];
    short.iter().any(says).then(|| io::ErrorKind::OutOfMemory.into())
}

impl StoreError {
    /// Whether a file in the store is gone or no longer what it was, so that `fsck` and a rebuild are called for.
    #[must_use]
    pub fn is_damage(&self) -> bool {
        matches!(self, Self::Missing { .. } | Self::Damaged { .. })
    }

    /// Whether it says nothing of what was asked, so that another machine, or this one later, may succeed: the system refused, a file
    /// was damaged and can be built again, or another process was in the way.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        matches!(self, Self::Io { .. } | Self::Hdf5 { .. } | Self::Busy { .. }) || self.is_damage()
    }

    /// For `map_err` on calls of the standard library.
    pub(super) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// For `map_err` on calls of the HDF5 library.
    pub(super) fn hdf5(action: &'static str, path: &Path) -> impl Fn(hdf5::Error) -> Self {
        let path = path.to_owned();
        move |error| Self::of_library(action, &path, error.to_string())
    }

    /// Whether the HDF5 library passes on a refusal of the system.
    pub(super) fn is_of_the_system(message: &str) -> bool {
        errno(message).is_some() || out_of_memory(message).is_some()
    }

    /// A refusal of the HDF5 library in its words.
    pub(super) fn of_library(action: &'static str, path: &Path, message: String) -> Self {
        let path = path.to_owned();
        let refused = errno(&message).map(io::Error::from_raw_os_error);
        match refused.or_else(|| out_of_memory(&message)) {
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
