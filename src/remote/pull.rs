//! Brings what a remote has into a store.

use std::sync::atomic::{AtomicU64, Ordering};

use super::error::RemoteError;
use super::upstream::Remote;
use deaflow_base::ArtifactId;
use deaflow_store::{Condition, Effort, Store};

/// What a pull came to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pulled {
    /// Artifacts that are here now and were not.
    pub artifacts: u64,
    /// Bytes of their files there.
    pub bytes: u64,
    /// Artifacts that were here.
    pub artifacts_here: u64,
    /// Records that are known of the remote.
    pub records: u64,
    /// Artifacts that could not be had, or are not what they should be.
    pub left: Vec<ArtifactId>,
}

/// Brings all that trusted signers have recorded. The store must read through the remote. `progress` is told how many artifacts of how many are done.
///
/// # Errors
/// When the store cannot be written.
pub fn pull_all(store: &Store, remote: &Remote, progress: &(dyn Fn(u64, u64) + Sync)) -> Result<Pulled, RemoteError> {
    let artifacts = remote.with_known(super::known::Known::artifacts);
    pull_some(store, remote, &artifacts, progress)
}

/// Brings some artifacts, with their chunks and the records that name them.
///
/// # Errors
/// As [`pull_all`].
pub fn pull_some(
    store: &Store,
    remote: &Remote,
    artifacts: &[ArtifactId],
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<Pulled, RemoteError> {
    let (before, total, done) = (remote.brought(), artifacts.len() as u64, AtomicU64::new(0));
    let own = store.without_upstream();
    let mut here = 0;
    for artifact in artifacts {
        here += u64::from(matches!(
            own.inspect(artifact, Effort::Quick)?,
            Condition::Intact { .. }
        ));
    }
    let step = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
    let mut left = store.fetch_all(artifacts, &step)?;
    left.sort_unstable();
    own.settle_records()?;
    store.save_index();
    let brought = remote.brought();
    Ok(Pulled {
        artifacts: brought.artifacts - before.artifacts,
        bytes: brought.bytes - before.bytes,
        artifacts_here: here,
        records: remote.count_records(),
        left,
    })
}
