//! Sends what a store has to a remote: objects first, manifests after their chunks, then the signed records that name them.

use std::collections::{BTreeSet, HashSet};
use std::sync::Mutex;
use std::sync::PoisonError;

use super::bucket::Unfinished;
use super::error::RemoteError;
use super::key::SigningKey;
use super::pack::{self, MOST_RECORDS, Statement};
use super::upstream::{OBJECTS, Remote, object_name, object_of};
use deaflow_base::{ArtifactId, side_by_side};
use deaflow_store::{Store, StoredArtifact};

/// What to push.
pub struct Push<'a> {
    /// From where.
    pub store: &'a Store,
    /// To where.
    pub remote: &'a Remote,
    /// Who signs.
    pub key: &'a SigningKey,
    /// These artifacts and all that they were made from; or all that the store has.
    pub roots: Option<Vec<ArtifactId>>,
    /// Whether objects and records are sent although they are there: those there may be damaged, or near the end of their age.
    pub again: bool,
}

/// What a push came to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pushed {
    /// Objects that were sent.
    pub objects: u64,
    /// Bytes of their files.
    pub bytes: u64,
    /// Records that were sent.
    pub records: u64,
    /// Objects that were there.
    pub objects_there: u64,
    /// Records that were there.
    pub records_there: u64,
    /// Records that others have signed and this store has only brought: they are not signed again.
    pub records_of_others: u64,
    /// Artifacts that are missing or damaged here: neither they nor their records were sent.
    pub left: Vec<(ArtifactId, String)>,
}

impl Push<'_> {
    /// Sends the file of an artifact, every byte of which is compared with its header before; why not, where it is damaged.
    fn send(&self, digest: &ArtifactId) -> Result<Result<u64, String>, RemoteError> {
        let (path, file, size) = match self.store.file_of(digest) {
            Ok(found) => found,
            Err(error) if error.is_damage() => return Ok(Err(error.to_string())),
            Err(error) => return Err(error.into()),
        };
        let note = self.remote.note_of(digest);
        let unfinished = Unfinished {
            note: &note,
            content: file.to_string(),
        };
        let name = object_name(digest);
        self.remote.bucket().put_file(&name, &path, size, &unfinished)?;
        Ok(Ok(size))
    }
}

/// Pushes. `progress` is told how many objects of how many are done. What has been sent stays, whatever happens: the next push goes on.
///
/// # Errors
/// When the remote cannot be reached or refuses, or the store cannot be read.
pub fn push(push: &Push<'_>, progress: &(dyn Fn(u64, u64) + Sync)) -> Result<Pushed, RemoteError> {
    let remote = push.remote;
    let held = push.store.stored_artifacts(push.roots.as_deref())?;
    remote.mark()?;
    let signer = push.key.public();
    let there = if push.again { HashSet::new() } else { objects(remote)? };
    let mut pushed = Pushed::default();
    let total = held.len() as u64;
    let done = Mutex::new(0);
    let step = || {
        // A number is added to in one step: a panic elsewhere leaves one that is right.
        let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
        *done += 1;
        progress(*done, total);
    };
    let mut missing: BTreeSet<ArtifactId> = BTreeSet::new();
    for batch in held.chunks(MOST_RECORDS) {
        send_all(push, batch, &there, &mut missing, &mut pushed, &step)?;
        let mut statements = Vec::new();
        for held in batch.iter().filter(|held| !missing.contains(&held.artifact)) {
            for record in &held.records {
                let is_there = remote.with_known(|known| known.has_said(&signer, &record.key, &record.artifact));
                if is_there && !push.again {
                    pushed.records_there += 1;
                } else if push.store.origin_of(record).is_some() {
                    // To sign is to have done it.
                    pushed.records_of_others += 1;
                } else {
                    statements.push(Statement::new(record.clone(), &held.parts));
                }
            }
        }
        pushed.records += statements.len() as u64;
        for pack in pack::divide(statements)? {
            remote.state(&pack, push.key)?;
        }
    }
    if pushed.records > 0 && pushed.objects_there > 0 {
        // What was there may have been removed before anything named it.
        let there = objects(remote)?;
        let mut again = Pushed::default();
        send_all(push, &held, &there, &mut missing, &mut again, &|| ())?;
        pushed.objects += again.objects;
        pushed.bytes += again.bytes;
    }
    Ok(pushed)
}

fn objects(remote: &Remote) -> Result<HashSet<ArtifactId>, RemoteError> {
    let listed = remote.bucket().list(OBJECTS)?;
    Ok(listed.iter().filter_map(|entry| object_of(&entry.name)).collect())
}

/// Sends those that are not there: chunks before the manifests that need them.
fn send_all(
    push: &Push<'_>,
    batch: &[StoredArtifact],
    there: &HashSet<ArtifactId>,
    missing: &mut BTreeSet<ArtifactId>,
    pushed: &mut Pushed,
    step: &(dyn Fn() + Sync),
) -> Result<(), RemoteError> {
    let (plain, manifests): (Vec<&StoredArtifact>, Vec<&StoredArtifact>) =
        batch.iter().partition(|held| held.parts.is_empty());
    for group in [plain, manifests] {
        let lacks = |held: &&StoredArtifact| held.parts.iter().any(|part| missing.contains(part));
        let (broken, whole): (Vec<&StoredArtifact>, Vec<&StoredArtifact>) = group.into_iter().partition(lacks);
        for held in broken {
            if missing.insert(held.artifact) {
                pushed
                    .left
                    .push((held.artifact, "a chunk of it is missing or damaged".to_owned()));
            }
        }
        let sent = side_by_side(&whole, |held| {
            let done = match there.contains(&held.artifact) {
                true => None,
                false => Some(push.send(&held.artifact)?),
            };
            step();
            Ok::<_, RemoteError>(Some((held.artifact, done)))
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
                    pushed.left.push((artifact, why));
                }
            }
        }
    }
    pushed.left.sort_unstable();
    Ok(())
}
