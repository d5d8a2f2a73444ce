//! Downloads missing artifacts and records from the upstream store.
//!
//! Downloaded files are not trusted: their bytes are compared with their header, another process reads their content
//! and computes its digest, and the result is written as a new file. So a store contains only files that this program
//! has written.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use super::artifact::Artifact;
use super::atomic;
use super::error::StoreError;
use super::inspect::{Condition, Effort};
use super::layout::{ORIGINS, REMOTES};
use super::open::Store;
use super::provenance::Provenance;
use super::quarantine::forget_bytes;
use super::record::{Lookup, Record};
use super::upstream::{Upstream, UpstreamLink};
use deaflow_base::{ActionKey, ArtifactId, Digest, concurrently, read_own};

/// Maximum length of the file with the origin of a record, bytes.
const MAX_ORIGIN: u64 = 1 << 12;

impl Store {
    /// Returns the same store with an upstream store, from which missing artifacts are downloaded when they are read.
    #[must_use]
    pub fn with_upstream(self, upstream: Arc<dyn Upstream>) -> Self {
        Self {
            upstream: Some(UpstreamLink::new(upstream)),
            ..self
        }
    }

    /// Returns the same store; an artifact that is not here then only exists if it can be downloaded, which is done when
    /// it is looked for.
    #[must_use]
    pub fn fetching(self) -> Self {
        let upstream = self.upstream.map(UpstreamLink::fetching);
        Self { upstream, ..self }
    }

    /// Returns the same store without its upstream store.
    #[must_use]
    pub fn without_upstream(&self) -> Self {
        Self {
            upstream: None,
            ..self.clone()
        }
    }

    /// Whether there is an upstream store.
    #[must_use]
    pub fn has_upstream(&self) -> bool {
        self.upstream.is_some()
    }

    fn upstream(&self) -> Option<&dyn Upstream> {
        self.upstream.as_ref().map(|link| &*link.store)
    }

    /// Returns the record of an action that was found here if it is trusted, otherwise that of the upstream store.
    pub(super) fn or_upstream_record(&self, found: Lookup, key: &ActionKey) -> Lookup {
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

    /// Returns the condition of an artifact that is not here; with [`Effort::Thorough`], or in a
    /// store that is [fetching](Store::fetching), it is downloaded.
    pub(super) fn inspect_upstream(
        &self,
        digest: &ArtifactId,
        effort: Effort,
    ) -> Result<Option<Condition>, StoreError> {
        let Some(found) = self.upstream().and_then(|upstream| upstream.find_artifact(digest)) else {
            return Ok(None);
        };
        let fetches = self.upstream.as_ref().is_some_and(|link| link.fetches);
        match effort {
            Effort::Quick if !fetches => Ok(Some(Condition::Elsewhere { size: found.size })),
            _ if self.fetch(digest)? => Ok(Some(self.without_upstream().inspect(digest, effort)?)),
            _ => Ok(None),
        }
    }

    /// Returns the chunks of a manifest that is not here, if the upstream store knows them.
    pub(super) fn upstream_parts(&self, digest: &ArtifactId) -> Option<Vec<ArtifactId>> {
        self.upstream()?.find_artifact(digest)?.parts
    }

    /// Returns the folder with the cached records of the remote at this place.
    #[must_use]
    pub fn remote_folder(&self, place: &Digest) -> PathBuf {
        self.root().join(REMOTES).join(place.short())
    }

    /// Whether the file of an artifact exists here; it may be damaged.
    #[must_use]
    pub fn has(&self, digest: &ArtifactId) -> bool {
        self.layout.object(digest).exists()
    }

    /// Returns the origin of a record that was downloaded; `None` if it was made here.
    #[must_use]
    pub fn origin_of(&self, record: &Record) -> Option<String> {
        let bytes = read_own(&self.origin_path(&record.key), MAX_ORIGIN).ok()?;
        let text = String::from_utf8(bytes).ok()?;
        let (origin, digest) = text.trim_end().rsplit_once(' ')?;
        // A record that was made here since differs.
        (digest == record.digest().ok()?.to_string()).then(|| origin.to_owned())
    }

    fn origin_path(&self, key: &ActionKey) -> PathBuf {
        let name = key.to_string();
        self.root().join(ORIGINS).join(&name[..2]).join(name)
    }

    /// Writes a record of another store, after the file with its origin.
    pub(super) fn put_record_of(&self, record: &Record, origin: &str) -> Result<(), StoreError> {
        let path = self.origin_path(&record.key);
        let text = format!("{origin} {}\n", record.digest()?);
        atomic::write_unsettled(&self.temporary_file()?, &path, text.as_bytes())?;
        self.put_record(record)
    }

    /// Downloads an artifact that is missing or damaged here, its chunks, and then its records. Returns whether all of
    /// it is here now; what cannot be downloaded or is not valid has to be built.
    ///
    /// # Errors
    /// If this store cannot be read or written.
    pub fn fetch(&self, digest: &ArtifactId) -> Result<bool, StoreError> {
        let here = self.without_upstream();
        let Some(link) = &self.upstream else {
            return Ok(matches!(here.inspect(digest, Effort::Quick)?, Condition::Intact { .. }));
        };
        let upstream = &*link.store;
        let _download = link.begin(*digest);
        if let Condition::Intact { .. } = here.inspect(digest, Effort::Quick)? {
            let complete = self.fetch_all(&here.parts(digest)?, &|| ())?.is_empty();
            if complete {
                self.fetch_records(digest)?;
            }
            return Ok(complete);
        }
        if upstream.find_artifact(digest).is_none() {
            return Ok(false);
        }
        self.quarantine_artifact(digest)?;
        let temporary = self.temporary_file()?;
        if !upstream.download(digest, &temporary)? {
            return Ok(false);
        }
        let mut imported = self.import(&temporary, digest);
        if imported.as_ref().is_err_and(is_invalid) {
            forget_bytes(&temporary);
            imported = self.import(&temporary, digest);
        }
        let why = match imported {
            Ok(true) => {
                let size = fs::metadata(&temporary).map_or(0, |metadata| metadata.len());
                upstream.accept(digest, size);
                self.fetch_records(digest)?;
                return Ok(true);
            }
            // The chunk has been reported.
            Ok(false) => return Ok(false),
            Err(StoreError::Damaged { reason, .. }) => reason,
            Err(error) if is_invalid(&error) => error.to_string(),
            Err(error) => return Err(error),
        };
        upstream.reject(digest, &why);
        Ok(false)
    }

    /// Writes the records that the upstream store has of an artifact, unless this store has its own.
    fn fetch_records(&self, digest: &ArtifactId) -> Result<(), StoreError> {
        let Some(upstream) = self.upstream() else {
            return Ok(());
        };
        let here = self.without_upstream();
        for (record, origin) in upstream.records_of(digest) {
            if !matches!(here.record(&record.key)?, Lookup::Absent) {
                continue;
            }
            // Refers to the file in this store.
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

    /// Downloads artifacts, several at once, and returns those that could not be downloaded. `progress` is called after
    /// each.
    ///
    /// # Errors
    /// As [`Store::fetch`].
    pub fn fetch_all(
        &self,
        digests: &[ArtifactId],
        progress: &(dyn Fn() + Sync),
    ) -> Result<Vec<ArtifactId>, StoreError> {
        concurrently(digests, |digest| {
            let is_here = self.fetch(digest)?;
            progress();
            Ok((!is_here).then_some(*digest))
        })
    }

    /// Writes the content of a downloaded file as a new artifact if it has the expected digest; returns whether all its
    /// chunks are here.
    fn import(&self, path: &Path, digest: &ArtifactId) -> Result<bool, StoreError> {
        let (artifact, object) = Artifact::read_uncached(path, digest)?;
        if !self.fetch_all(&object.parts, &|| ())?.is_empty() {
            return Ok(false);
        }
        let provenance = self.provenance_of(&artifact)?;
        self.without_upstream().put(&object, &provenance)?;
        Ok(true)
    }

    /// Returns the provenance of a downloaded artifact: that in its file if a record has the digest of this file,
    /// otherwise that of a record.
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

/// Whether an error says that a downloaded file is not the artifact.
fn is_invalid(error: &StoreError) -> bool {
    matches!(
        error,
        StoreError::Damaged { .. } | StoreError::Object(_) | StoreError::Parts { .. } | StoreError::Hdf(_)
    )
}
