//! The interface to an upstream store, from which missing artifacts are downloaded.

use std::collections::HashSet;
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, PoisonError};

use super::error::StoreError;
use super::record::Record;
use deaflow_base::{ActionKey, ArtifactId};

/// An artifact that an upstream store is known to have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UpstreamArtifact {
    /// Length of its file in bytes; 0 if unknown.
    pub size: u64,
    /// The chunks of a manifest, empty for any other artifact; `None` if unknown.
    pub parts: Option<Vec<ArtifactId>>,
}

/// Another store. It is not trusted: it may have lost what it lists, and may send any file.
pub trait Upstream: Send + Sync {
    /// Returns its record of an action.
    fn record(&self, key: &ActionKey) -> Option<Record>;

    /// Returns its records of an artifact, each with its origin: a text that identifies who signed it.
    fn records_of(&self, artifact: &ArtifactId) -> Vec<(Record, String)>;

    /// Whether a record that was downloaded earlier is still trusted, given its origin.
    fn is_trusted(&self, record: &Record, origin: &str) -> bool;

    /// Receives a record of this store, so that differences can be reported.
    fn compare(&self, record: &Record);

    /// Returns what is known of an artifact, if the upstream store has it.
    fn find_artifact(&self, artifact: &ArtifactId) -> Option<UpstreamArtifact>;

    /// Downloads the file of an artifact to `target`; returns false if that is not possible.
    ///
    /// # Errors
    /// If `target` cannot be written.
    fn download(&self, artifact: &ArtifactId, target: &Path) -> Result<bool, StoreError>;

    /// Is called when a downloaded file was valid; `size` is its length in bytes.
    fn accept(&self, artifact: &ArtifactId, size: u64);

    /// Is called when a downloaded file was not valid, with the reason.
    fn reject(&self, artifact: &ArtifactId, why: &str);
}

/// An upstream store, and the artifacts that are being downloaded from it.
#[derive(Clone)]
pub struct UpstreamLink {
    pub(super) store: Arc<dyn Upstream>,
    /// Whether what is looked for is downloaded.
    pub(super) fetches: bool,
    downloads: Arc<(Mutex<HashSet<ArtifactId>>, Condvar)>,
}

/// A download by this thread.
pub(super) struct Download<'a>(&'a UpstreamLink, ArtifactId);

impl UpstreamLink {
    pub fn new(store: Arc<dyn Upstream>) -> Self {
        Self {
            store,
            fetches: false,
            downloads: Arc::default(),
        }
    }

    /// Downloads what is looked for.
    pub(super) fn fetching(self) -> Self {
        Self { fetches: true, ..self }
    }

    /// Waits until no other thread downloads the artifact.
    pub(super) fn begin(&self, digest: ArtifactId) -> Download<'_> {
        let (downloads, ended) = &*self.downloads;
        let mut set = downloads.lock().unwrap_or_else(PoisonError::into_inner);
        while !set.insert(digest) {
            set = ended.wait(set).unwrap_or_else(PoisonError::into_inner);
        }
        Download(self, digest)
    }
}

impl Drop for Download<'_> {
    fn drop(&mut self) {
        let (downloads, ended) = &*self.0.downloads;
        downloads.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.1);
        ended.notify_all();
    }
}
