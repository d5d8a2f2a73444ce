//! Another store, from which what is not here may be had.
//!
//! Nobody's word is taken for a file that comes from there: its bytes are compared with its header, its content is read in
//! another process and digested, and what was found is written anew as this program writes it. So nothing stands in a
//! store that this program has not written, and descriptions and layouts of others' files end with the temporary file.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::SystemTime;

use super::artifact::Artifact;
use super::atomic;
use super::error::StoreError;
use super::inspect::{Condition, Effort};
use super::layout::{ORIGINS, REMOTES};
use super::open::Store;
use super::provenance::Provenance;
use super::record::{Lookup, Record};
use deaflow_base::{ActionKey, ArtifactId, Digest, encode, read_own, side_by_side};

/// What says who has said what a record says is shorter, bytes.
const MAX_ORIGIN: u64 = 1 << 12;

/// What another store is known to have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UpstreamArtifact {
    /// Length of its file, bytes; 0 where that is not known.
    pub size: u64,
    /// The chunks of a manifest, none of another artifact; or unknown.
    pub parts: Option<Vec<ArtifactId>>,
}

/// Another store. What it says it has may have gone, and what it gives may be anything.
pub trait Upstream: Send + Sync {
    /// What it says that an action made.
    fn record(&self, key: &ActionKey) -> Option<Record>;

    /// The records that name an artifact, each with who says so, in the words by which [`Upstream::is_trusted`] knows it.
    fn records_of(&self, artifact: &ArtifactId) -> Vec<(Record, String)>;

    /// Whether a record that was brought counts yet, given who said so. What this store has done itself is not asked about.
    fn is_trusted(&self, record: &Record, origin: &str) -> bool;

    /// Is told of a record of this store, so that it can say where it differs.
    fn compare(&self, record: &Record);

    /// What it is known to have.
    fn find_artifact(&self, artifact: &ArtifactId) -> Option<UpstreamArtifact>;

    /// Writes the file of an artifact to `target`; says whether there was one. Where it cannot be had, whoever asked goes on
    /// without.
    ///
    /// # Errors
    /// When `target` cannot be written.
    fn download(&self, artifact: &ArtifactId, target: &Path) -> Result<bool, StoreError>;

    /// Is told that what it gave was what was asked for: a file of so many bytes.
    fn accept(&self, artifact: &ArtifactId, size: u64);

    /// Is told that what it gave was not what was asked for; why.
    fn reject(&self, artifact: &ArtifactId, why: &str);
}

/// Another store, and what is being brought from it.
#[derive(Clone)]
pub struct UpstreamLink {
    upstream: Arc<dyn Upstream>,
    under_way: Arc<(Mutex<HashSet<ArtifactId>>, Condvar)>,
}

/// Shows that an artifact is being brought by this thread.
struct OnTheWay<'a>(&'a UpstreamLink, ArtifactId);

impl UpstreamLink {
    /// Waits until no other thread brings the artifact.
    fn begin(&self, digest: ArtifactId) -> OnTheWay<'_> {
        let (under_way, ended) = &*self.under_way;
        let mut set = under_way.lock().unwrap_or_else(PoisonError::into_inner);
        while !set.insert(digest) {
            set = ended.wait(set).unwrap_or_else(PoisonError::into_inner);
        }
        OnTheWay(self, digest)
    }
}

impl Drop for OnTheWay<'_> {
    fn drop(&mut self) {
        let (under_way, ended) = &*self.0.under_way;
        under_way.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.1);
        ended.notify_all();
    }
}

impl Store {
    /// The same store; what is not in it is looked for in another one, and brought when it is read.
    #[must_use]
    pub fn with_upstream(self, upstream: Arc<dyn Upstream>) -> Self {
        Self {
            upstream: Some(UpstreamLink {
                upstream,
                under_way: Arc::default(),
            }),
            ..self
        }
    }

    /// The same store, without any other behind it.
    #[must_use]
    pub fn without_upstream(&self) -> Self {
        Self {
            upstream: None,
            ..self.clone()
        }
    }

    /// Whether there is another store behind it.
    #[must_use]
    pub fn has_upstream(&self) -> bool {
        self.upstream.is_some()
    }

    fn upstream(&self) -> Option<&dyn Upstream> {
        self.upstream.as_ref().map(|upstream| &*upstream.upstream)
    }

    /// What counts of what was found here of an action, and of what the other store says.
    pub(super) fn or_record_elsewhere(&self, found: Lookup, key: &ActionKey) -> Lookup {
        let Some(upstream) = self.upstream() else {
            return found;
        };
        if let Lookup::Found(record, _) = &found {
            match self.origin_of(record) {
                Some(origin) if !upstream.is_trusted(record, &origin) => {}
                Some(_) => return found,
                None => {
                    upstream.compare(record);
                    return found;
                }
            }
        } else if matches!(found, Lookup::Damaged(_)) {
            return found;
        }
        upstream.record(key).map_or(Lookup::Absent, |record| {
            let written = humantime::parse_rfc3339(&record.created).unwrap_or(SystemTime::UNIX_EPOCH);
            Lookup::Found(Box::new(record), written)
        })
    }

    /// The condition of what is not here: promised, or with [`Effort::Thorough`] brought.
    pub(super) fn look_elsewhere(&self, digest: &ArtifactId, effort: Effort) -> Result<Option<Condition>, StoreError> {
        let Some(promise) = self.upstream().and_then(|upstream| upstream.find_artifact(digest)) else {
            return Ok(None);
        };
        match effort {
            Effort::Quick => Ok(Some(Condition::Elsewhere { size: promise.size })),
            Effort::Thorough if self.fetch(digest)? => Ok(Some(self.without_upstream().inspect(digest, effort)?)),
            Effort::Thorough => Ok(None),
        }
    }

    /// The chunks of a manifest that is not here, where the other store says them.
    pub(super) fn parts_elsewhere(&self, digest: &ArtifactId) -> Option<Vec<ArtifactId>> {
        self.upstream()?.find_artifact(digest)?.parts
    }

    /// Where what was read of a remote at this place is kept.
    #[must_use]
    pub fn remote_folder(&self, place: &Digest) -> PathBuf {
        self.root().join(REMOTES).join(place.short())
    }

    /// Whether an artifact is here, which may be damaged.
    #[must_use]
    pub fn has(&self, digest: &ArtifactId) -> bool {
        self.layout.object(digest).exists()
    }

    /// Who has said what a record says, where it was brought from another store and not made here.
    #[must_use]
    pub fn origin_of(&self, record: &Record) -> Option<String> {
        let bytes = read_own(&self.origin_path(&record.key), MAX_ORIGIN).ok()?;
        let text = String::from_utf8(bytes).ok()?;
        let (origin, digest) = text.trim_end().rsplit_once(' ')?;
        // Whatever was made here since is another record.
        (digest == Self::digest_of(record).ok()?.to_string()).then(|| origin.to_owned())
    }

    fn origin_path(&self, key: &ActionKey) -> PathBuf {
        let name = key.to_string();
        self.root().join(ORIGINS).join(&name[..2]).join(name)
    }

    fn digest_of(record: &Record) -> Result<Digest, StoreError> {
        Ok(Digest::of(&encode(record)?))
    }

    /// Writes a record that another store has, and before it who says so.
    pub(super) fn put_record_of(&self, record: &Record, origin: &str) -> Result<(), StoreError> {
        let path = self.origin_path(&record.key);
        let text = format!("{origin} {}\n", Self::digest_of(record)?);
        atomic::write_unsettled(&self.temporary_file()?, &path, text.as_bytes())?;
        self.put_record(record)
    }

    /// Brings an artifact that is not here, or is damaged, from the other store, with its chunks, and after it the records that name it.
    /// Says whether all of it is here now: what cannot be had, or is not what it should be, is left out, and whoever needs it builds it.
    ///
    /// # Errors
    /// When this store cannot be read or written.
    pub fn fetch(&self, digest: &ArtifactId) -> Result<bool, StoreError> {
        let here = self.without_upstream();
        let Some(link) = &self.upstream else {
            return Ok(matches!(here.inspect(digest, Effort::Quick)?, Condition::Intact { .. }));
        };
        let upstream = &*link.upstream;
        let _on_the_way = link.begin(*digest);
        if let Condition::Intact { .. } = here.inspect(digest, Effort::Quick)? {
            let whole = self.fetch_all(&here.parts(digest)?, &|| ())?.is_empty();
            if whole {
                self.take_records(digest)?;
            }
            return Ok(whole);
        }
        if upstream.find_artifact(digest).is_none() {
            return Ok(false);
        }
        self.quarantine_artifact(digest)?;
        let temporary = self.temporary_file()?;
        if !upstream.download(digest, &temporary)? {
            return Ok(false);
        }
        let why = match self.take_in(&temporary, digest) {
            Ok(true) => {
                let size = fs::metadata(&temporary).map_or(0, |metadata| metadata.len());
                upstream.accept(digest, size);
                self.take_records(digest)?;
                return Ok(true);
            }
            Ok(false) => "a chunk of it cannot be had".to_owned(),
            Err(StoreError::Damaged { reason, .. }) => reason,
            Err(error @ (StoreError::Object(_) | StoreError::Parts { .. } | StoreError::Hdf(_))) => error.to_string(),
            Err(error) => return Err(error),
        };
        upstream.reject(digest, &why);
        Ok(false)
    }

    /// Writes the records of the other store that name an artifact that is here, where this store has none of their own.
    fn take_records(&self, digest: &ArtifactId) -> Result<(), StoreError> {
        let Some(upstream) = self.upstream() else {
            return Ok(());
        };
        let here = self.without_upstream();
        for (record, origin) in upstream.records_of(digest) {
            if !matches!(here.record(&record.key)?, Lookup::Absent) {
                continue;
            }
            // Of the file as it stands here.
            let (_, file_digest, size) = here.file_of(digest)?;
            let record = Record {
                file_digest,
                size,
                ..record
            };
            here.put_record_of(&record, &origin)?;
        }
        Ok(())
    }

    /// Brings artifacts, several at once, and says which could not be had. `progress` is told of each that is done.
    ///
    /// # Errors
    /// As [`Store::fetch`].
    pub fn fetch_all(
        &self,
        digests: &[ArtifactId],
        progress: &(dyn Fn() + Sync),
    ) -> Result<Vec<ArtifactId>, StoreError> {
        side_by_side(digests, |digest| {
            let there = self.fetch(digest)?;
            progress();
            Ok((!there).then_some(*digest))
        })
    }

    /// Writes anew what stands in a file of another store, if it is the artifact that it should be; says whether all its chunks are here.
    fn take_in(&self, path: &Path, digest: &ArtifactId) -> Result<bool, StoreError> {
        let (artifact, object) = Artifact::read_uncached(path, digest)?;
        if !self.fetch_all(&object.parts, &|| ())?.is_empty() {
            return Ok(false);
        }
        let provenance = self.provenance_of(&artifact)?;
        self.without_upstream().put(&object, &provenance)?;
        Ok(true)
    }

    /// Who made an artifact, as far as somebody vouches for that: what its file says, where a record names that very file, or else what a
    /// record says.
    fn provenance_of(&self, artifact: &Artifact) -> Result<Provenance, StoreError> {
        let digest = artifact.digest();
        let records = self
            .upstream()
            .map(|upstream| upstream.records_of(&digest))
            .unwrap_or_default();
        let file = artifact.file_digest()?;
        if records.iter().any(|(record, _)| record.file_digest == file) {
            return Ok(Provenance::of_entries(&artifact.provenance()?));
        }
        Ok(records
            .into_iter()
            .next()
            .map_or_else(Provenance::default, |(record, _)| Provenance::of_record(&record)))
    }
}
