//! Checks whether an artifact exists and is intact, quickly or thoroughly.
//!
//! Planning must notice a missing or damaged artifact, but take less than a second on a store of gigabytes. So it
//! trusts the index if the stamp of a file has not changed, as git does, and verifies the other files. Files that are
//! read as inputs are always verified in full, and `fsck` verifies all.

use super::artifact::Artifact;
use super::error::StoreError;
use super::index::Structure;
use super::open::Store;
use super::quarantine::{forget_bytes, unsteady};
use super::record::Record;
use deaflow_base::ArtifactId;

/// Condition of an artifact.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Condition {
    /// It is as it was written, as far as it was checked.
    Intact {
        /// Length of the file in bytes.
        size: u64,
    },
    /// It is not in this store, but the upstream store has it.
    Elsewhere {
        /// Length of the file in bytes in that store.
        size: u64,
    },
    /// The file does not exist.
    Missing,
    /// The file differs from what was written; with the reason.
    Damaged(String),
    /// It is intact, but of another kind than the record that names it.
    OtherKind(String),
}

/// How thoroughly to check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Compares the stamps of files in the index, and verifies every byte of other files.
    Quick,
    /// Verifies every byte.
    Thorough,
}

impl Store {
    /// Returns the condition of the file of an artifact (without the chunks of a manifest).
    ///
    /// # Errors
    /// If the system reports an error, for instance a missing permission.
    pub fn inspect(&self, digest: &ArtifactId, effort: Effort) -> Result<Condition, StoreError> {
        let looked = condition(self.look(digest, effort).map(|(size, _)| Condition::Intact { size }))?;
        self.or_elsewhere(looked, digest, effort)
    }

    /// Looks in the upstream store for what is missing or damaged here.
    fn or_elsewhere(&self, looked: Condition, digest: &ArtifactId, effort: Effort) -> Result<Condition, StoreError> {
        match looked {
            Condition::Missing | Condition::Damaged(_) => Ok(self.inspect_upstream(digest, effort)?.unwrap_or(looked)),
            looked => Ok(looked),
        }
    }

    /// Returns the length of an intact file, and its structure if that is known without opening it.
    fn look(&self, digest: &ArtifactId, effort: Effort) -> Result<(u64, Option<Structure>), StoreError> {
        let path = self.layout.object(digest);
        let (header, structure) = match effort {
            Effort::Quick => self.verified.glance(&path, digest)?,
            Effort::Thorough => (self.verified.verify(&path, digest)?, None),
        };
        Ok((header.size, structure))
    }

    /// Returns the condition of the artifact of a record: as [`Store::inspect`], and it must be of the kind of the
    /// record.
    ///
    /// # Errors
    /// As [`Store::inspect`].
    pub fn inspect_made(&self, record: &Record, effort: Effort) -> Result<Condition, StoreError> {
        let look = || {
            let (size, known) = self.look(&record.artifact, effort)?;
            let structure = match known {
                Some(structure) => structure,
                None => self
                    .verified
                    .structure(&self.layout.object(&record.artifact), &record.artifact)?,
            };
            let kind = &structure.listing.kind;
            Ok(match *kind == record.action.kind {
                true => Condition::Intact { size },
                false => Condition::OtherKind(kind.clone()),
            })
        };
        let looked = condition(look())?;
        if matches!(looked, Condition::Intact { .. } | Condition::OtherKind(_)) {
            return Ok(looked);
        }
        match self.or_elsewhere(looked, &record.artifact, effort)? {
            // It was downloaded just now: its kind is not checked yet.
            Condition::Intact { .. } => condition(look()),
            looked => Ok(looked),
        }
    }

    /// Returns the chunks of an intact manifest; empty for any other artifact.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn parts(&self, digest: &ArtifactId) -> Result<Vec<ArtifactId>, StoreError> {
        let here = || {
            let structure = self.verified.structure(&self.layout.object(digest), digest)?;
            Ok::<_, StoreError>(structure.parts.to_vec())
        };
        match here() {
            Err(error) if error.is_damage() && self.upstream.is_some() => match self.upstream_parts(digest) {
                Some(parts) => Ok(parts),
                None => self.fetch(digest).and_then(|_| here()),
            },
            parts => parts,
        }
    }

    /// Moves the file of an artifact that was found damaged to quarantine, if it is damaged when it is read again.
    ///
    /// # Errors
    /// If the system reports an error, or the file is intact now.
    pub fn quarantine_artifact(&self, digest: &ArtifactId) -> Result<(), StoreError> {
        self.verified.forget(digest);
        let path = self.layout.object(digest);
        forget_bytes(&path);
        match Artifact::read_uncached(&path, digest) {
            Ok(_) => Err(unsteady(
                &path,
                &StoreError::damaged(&path, "it was damaged when it was read first"),
            )),
            Err(error @ StoreError::Io { .. }) => Err(error),
            Err(_) => self.quarantine(&path).map(|_| ()),
        }
    }
}

/// Turns the errors for missing and damaged files into conditions.
fn condition(looked: Result<Condition, StoreError>) -> Result<Condition, StoreError> {
    match looked {
        Err(StoreError::Missing { .. }) => Ok(Condition::Missing),
        Err(StoreError::Damaged { reason, .. }) => Ok(Condition::Damaged(reason)),
        looked => looked,
    }
}
