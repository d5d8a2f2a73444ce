//! Pull: copies artifacts and records of a remote to a store.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering};

use super::error::RemoteError;
use super::trusted_records::TrustedRecords;
use super::upstream::Remote;
use deaflow_base::ArtifactId;
use deaflow_store::{Condition, Effort, Store};

/// The result of a pull.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PullReport {
    /// Number of artifacts that were copied, chunks among them.
    pub artifacts: u64,
    /// Size of their files in bytes.
    pub bytes: u64,
    /// Number of artifacts that the store had already, chunks among them.
    pub artifacts_here: u64,
    /// Number of known records of the remote.
    pub records: u64,
    /// Artifacts that could not be copied.
    pub failed: Vec<ArtifactId>,
}

/// Copies all artifacts that trusted signers have recorded. The store must have the remote as its upstream. `progress`
/// receives the numbers of finished and of all artifacts.
///
/// # Errors
/// Returns an error if the store cannot be written.
pub fn pull_all(
    store: &Store,
    remote: &Remote,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<PullReport, RemoteError> {
    remote.retry();
    let artifacts = remote.with_records(TrustedRecords::artifacts);
    pull_some(store, remote, &artifacts, progress)
}

/// Copies some artifacts, with their chunks and records. Those that were invalid are only tried after
/// [`Remote::retry`].
///
/// # Errors
/// As [`pull_all`].
pub fn pull_some(
    store: &Store,
    remote: &Remote,
    artifacts: &[ArtifactId],
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<PullReport, RemoteError> {
    let (before, total, done) = (remote.downloads(), artifacts.len() as u64, AtomicU64::new(0));
    let own = store.without_upstream();
    let step = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
    let mut failed = store.fetch_all(artifacts, &step)?;
    failed.sort_unstable();
    own.settle_records()?;
    store.save_index();
    let after = remote.downloads();
    let fetched = after.artifacts - before.artifacts;
    Ok(PullReport {
        artifacts: fetched,
        bytes: after.bytes - before.bytes,
        artifacts_here: with_chunks(&own, artifacts)?.saturating_sub(fetched),
        records: remote.count_records(),
        failed,
    })
}

/// Returns how many of some artifacts and of their chunks a store has: several artifacts may share chunks.
fn with_chunks(store: &Store, artifacts: &[ArtifactId]) -> Result<u64, RemoteError> {
    let mut all = BTreeSet::new();
    for id in artifacts {
        if let Condition::Intact { .. } = store.inspect(id, Effort::Quick)? {
            all.insert(*id);
            all.extend(store.artifact(id)?.parts().iter().copied());
        }
    }
    Ok(all.len() as u64)
}
