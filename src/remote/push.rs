//! Push: copies artifacts of a store to a remote, manifests after their chunks, and then the signed records that name
//! them.

use std::collections::{BTreeSet, HashSet};
use std::sync::atomic::{AtomicU64, Ordering};

use super::bucket::UploadNote;
use super::error::RemoteError;
use super::key::SigningKey;
use super::pack::{self, MOST_RECORDS, Statement};
use super::upstream::{Remote, object_name};
use deaflow_base::{ArtifactId, concurrently};
use deaflow_store::{Store, StoredArtifact};

/// What to push.
pub struct Push<'a> {
    /// Source.
    pub store: &'a Store,
    /// Destination.
    pub remote: &'a Remote,
    /// Key that signs the records.
    pub key: &'a SigningKey,
    /// Artifacts to push with all that they were made from; `None` for the whole store.
    pub roots: Option<Vec<ArtifactId>>,
    /// Whether to send objects and records that the remote has already: they may be damaged or expire soon.
    pub again: bool,
}

/// The result of a push.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PushReport {
    /// Number of objects that were sent.
    pub objects: u64,
    /// Size of these objects in bytes.
    pub bytes: u64,
    /// Number of records that were sent.
    pub records: u64,
    /// Number of objects that the remote had already and that were not found invalid.
    pub objects_there: u64,
    /// Number of records that the remote had already.
    pub records_there: u64,
    /// Number of records that were pulled from others; they are not signed again.
    pub records_of_others: u64,
    /// Missing or damaged artifacts with the reason; neither they nor their records were sent.
    pub failed: Vec<(ArtifactId, String)>,
}

impl Push<'_> {
    /// Verifies and sends the file of an artifact; returns its size, or the reason why it is damaged.
    fn send(&self, digest: &ArtifactId) -> Result<Result<u64, String>, RemoteError> {
        let (path, file, size) = match self.store.file_of(digest) {
            Ok(found) => found,
            Err(error) if error.is_damage() => return Ok(Err(error.to_string())),
            Err(error) => return Err(error.into()),
        };
        let note = UploadNote {
            path: &self.remote.upload_note(digest),
            content: file.to_string(),
        };
        self.remote
            .bucket()
            .put_file(&object_name(digest), &path, size, &note)?;
        self.remote.replaced(digest);
        Ok(Ok(size))
    }
}

/// Pushes artifacts and records. `progress` receives the numbers of finished and of all objects. After an interruption
/// the next push continues.
///
/// # Errors
/// Returns an error if the remote cannot be reached or refuses, or the store cannot be read.
pub fn push(push: &Push<'_>, progress: &(dyn Fn(u64, u64) + Sync)) -> Result<PushReport, RemoteError> {
    let remote = push.remote;
    let stored = push.store.stored_artifacts(push.roots.as_deref())?;
    remote.write_marker()?;
    let signer = push.key.public();
    let there = match push.again {
        true => HashSet::new(),
        false => remote.valid_objects()?,
    };
    let mut pushed = PushReport::default();
    let total = stored.len() as u64;
    let done = AtomicU64::new(0);
    let step = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
    let mut missing: BTreeSet<ArtifactId> = BTreeSet::new();
    for batch in stored.chunks(MOST_RECORDS) {
        send_all(push, batch, &there, &mut missing, &mut pushed, &step)?;
        let mut statements = Vec::new();
        for stored in batch.iter().filter(|stored| !missing.contains(&stored.artifact)) {
            for record in &stored.records {
                let is_there = remote.with_records(|known| known.has_signed(&signer, &record.key, &record.artifact));
                if is_there && !push.again {
                    pushed.records_there += 1;
                } else if push.store.origin_of(record).is_some() {
                    // Users sign only their own results.
                    pushed.records_of_others += 1;
                } else {
                    statements.push(Statement::new(record.clone(), &stored.parts));
                }
            }
        }
        pushed.records += statements.len() as u64;
        for pack in pack::divide(statements)? {
            remote.publish(&pack, push.key)?;
        }
    }
    if pushed.records > 0 && pushed.objects_there > 0 {
        // Objects of the remote may have been removed before a record named them.
        let there = remote.valid_objects()?;
        let mut again = PushReport::default();
        send_all(push, &stored, &there, &mut missing, &mut again, &|| ())?;
        pushed.objects += again.objects;
        pushed.bytes += again.bytes;
    }
    Ok(pushed)
}

/// Sends artifacts that the remote does not have, chunks before manifests.
fn send_all(
    push: &Push<'_>,
    batch: &[StoredArtifact],
    there: &HashSet<ArtifactId>,
    missing: &mut BTreeSet<ArtifactId>,
    pushed: &mut PushReport,
    step: &(dyn Fn() + Sync),
) -> Result<(), RemoteError> {
    let (plain, manifests): (Vec<&StoredArtifact>, Vec<&StoredArtifact>) =
        batch.iter().partition(|stored| stored.parts.is_empty());
    for group in [plain, manifests] {
        let lacks = |stored: &&StoredArtifact| stored.parts.iter().any(|part| missing.contains(part));
        let (broken, whole): (Vec<&StoredArtifact>, Vec<&StoredArtifact>) = group.into_iter().partition(lacks);
        for stored in broken {
            if missing.insert(stored.artifact) {
                pushed
                    .failed
                    .push((stored.artifact, "one of its chunks is missing or damaged".to_owned()));
            }
        }
        let sent = concurrently(&whole, |stored| {
            let done = match there.contains(&stored.artifact) {
                true => None,
                false => Some(push.send(&stored.artifact)?),
            };
            step();
            Ok::<_, RemoteError>(Some((stored.artifact, done)))
        })?;
        for (artifact, done) in sent {
            match done {
                None => pushed.objects_there += 1,
                Some(Ok(size)) => {
                    pushed.objects += 1;
                    pushed.bytes += size;
                }
                Some(Err(why)) => {
                    missing.insert(artifact);
                    pushed.failed.push((artifact, why));
                }
            }
        }
    }
    pushed.failed.sort_unstable();
    Ok(())
}
