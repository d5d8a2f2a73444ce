//! What collections have removed, and when: a line of JSON for each artifact, so that whatever leads to one that is
//! gone can say so.
//!
//! Nothing depends on it, and it may be deleted at any time.

use serde::{Deserialize, Serialize};

use super::atomic;
use super::error::StoreError;
use super::gc::GcPlan;
use super::open::Store;
use deaflow_base::{ArtifactId, read_own};

/// Maximum length of the file, bytes, for some hundred thousand artifacts; the oldest lines are removed.
const MAX_LENGTH: usize = 16 << 20;

/// An artifact that a collection has removed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RemovedArtifact {
    /// The artifact.
    pub digest: ArtifactId,
    /// Kind of the stage or chunk; empty if unknown.
    pub kind: String,
    /// Length of its file in bytes.
    pub size: u64,
    /// When it was removed, in UTC, RFC 3339.
    pub at: String,
}

#[derive(Serialize, Deserialize)]
struct Line {
    digest: String,
    #[serde(default)]
    kind: String,
    #[serde(default)]
    size: u64,
    at: String,
}

impl Store {
    /// Remembers what a collection is about to remove. The store must be held alone.
    ///
    /// # Errors
    /// If the system reports an error.
    pub(super) fn remember_removed(&self, collection: &GcPlan, at: &str) -> Result<(), StoreError> {
        if collection.removed.is_empty() {
            return Ok(());
        }
        let mut known = self.removed_lines();
        for artifact in &collection.removed {
            let line = Line {
                digest: artifact.digest.to_string(),
                kind: artifact.kind.clone(),
                size: artifact.size,
                at: at.to_owned(),
            };
            serde_json::to_writer(&mut known, &line)?;
            known.push(b'\n');
        }
        if known.len() > MAX_LENGTH {
            let from = known.len() - MAX_LENGTH;
            let cut = known[from..].iter().position(|byte| *byte == b'\n');
            known.drain(..cut.map_or(known.len(), |at| from + at + 1));
        }
        let folder = self.temporary()?;
        atomic::write(&folder.path().join("removed"), &self.layout.removed(), &known)
    }

    /// What collections have removed that is still remembered, oldest first. A line, or a file, that cannot be read is
    /// passed over.
    #[must_use]
    pub fn removed(&self) -> Vec<RemovedArtifact> {
        let lines = self.removed_lines();
        let lines = lines.split(|byte| *byte == b'\n');
        let read = |line: &[u8]| {
            let Line { digest, kind, size, at } = serde_json::from_slice(line).ok()?;
            let digest = digest.parse().ok()?;
            Some(RemovedArtifact { digest, kind, size, at })
        };
        lines.filter_map(read).collect()
    }

    /// When a collection removed an artifact that is not here; none where it has been built again since, and is gone
    /// for another reason.
    ///
    /// # Errors
    /// If the records cannot be read.
    pub fn removal_of(&self, digest: &ArtifactId) -> Result<Option<RemovedArtifact>, StoreError> {
        let removed = self.removed().into_iter().rfind(|removed| removed.digest == *digest);
        let Some(removed) = removed.filter(|_| !self.has(digest)) else {
            return Ok(None);
        };
        let mut is_promised = false;
        self.each_record(|record| is_promised |= record.artifact == *digest)?;
        Ok((!is_promised).then_some(removed))
    }

    fn removed_lines(&self) -> Vec<u8> {
        read_own(&self.layout.removed(), 2 * MAX_LENGTH as u64).unwrap_or_default()
    }
}
