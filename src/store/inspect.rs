//! Whether an artifact is there and whole, at a cost that suits the occasion.
//!
//! Planning must notice a missing or damaged artifact and yet take less than a second over a store of gigabytes. So it
//! believes the index where a file's stamp is the one that the index knows, as git does, and digests what the index does not
//! know. Whatever is read as an input is verified in full, and so is all by `fsck`.

use super::error::StoreError;
use super::index::Structure;
use super::open::Store;
use super::record::Record;
use deaflow_base::ArtifactId;

/// State of an artifact.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Condition {
    /// As it was written, as far as was looked.
    Intact {
        /// Length of the file in bytes.
        size: u64,
    },
    /// It is not here, and another store is known to have it.
    Elsewhere {
        /// Length of the file in bytes, as it is there.
        size: u64,
    },
    /// There is no file.
    Missing,
    /// The file is not what was written; why.
    Damaged(String),
    /// It is as it was written, and made by an action of another kind than the record that names it.
    OtherKind(String),
}

/// How much to look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// The stamps of files that the index knows, and every byte of the others.
    Quick,
    /// Every byte.
    Thorough,
}

impl Store {
    /// The condition of one artifact file (not of a manifest's chunks).
    ///
    /// # Errors
    /// When the system refuses, for instance for want of permission.
    pub fn inspect(&self, digest: &ArtifactId, effort: Effort) -> Result<Condition, StoreError> {
        let looked = condition(self.look(digest, effort).map(|(size, _)| Condition::Intact { size }))?;
        self.or_elsewhere(looked, digest, effort)
    }

    /// What is missing or damaged here may be elsewhere.
    fn or_elsewhere(&self, looked: Condition, digest: &ArtifactId, effort: Effort) -> Result<Condition, StoreError> {
        match looked {
            Condition::Missing | Condition::Damaged(_) => Ok(self.look_elsewhere(digest, effort)?.unwrap_or(looked)),
            looked => Ok(looked),
        }
    }

    /// Length of an intact file, and what stands in it where that is known without opening it.
    fn look(&self, digest: &ArtifactId, effort: Effort) -> Result<(u64, Option<Structure>), StoreError> {
        let path = self.layout.object(digest);
        let (header, structure) = match effort {
            Effort::Quick => self.verified.glance(&path, digest)?,
            Effort::Thorough => (self.verified.verify(&path, digest)?, None),
        };
        Ok((header.size, structure))
    }

    /// The condition of what a record says was made: as [`Store::inspect`], and it must be of the record's kind.
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
            // It has been brought: of which kind it is has yet to be seen.
            Condition::Intact { .. } => condition(look()),
            looked => Ok(looked),
        }
    }

    /// The chunks of a manifest that is known to be intact; none of another artifact.
    ///
    /// # Errors
    /// When it has become unreadable since.
    pub fn parts(&self, digest: &ArtifactId) -> Result<Vec<ArtifactId>, StoreError> {
        let here = || {
            let structure = self.verified.structure(&self.layout.object(digest), digest)?;
            Ok::<_, StoreError>(structure.parts.to_vec())
        };
        match here() {
            Err(error) if error.is_damage() && self.upward.is_some() => match self.parts_elsewhere(digest) {
                Some(parts) => Ok(parts),
                None => self.fetch(digest).and_then(|_| here()),
            },
            parts => parts,
        }
    }

    /// Moves an artifact's file aside.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn quarantine_artifact(&self, digest: &ArtifactId) -> Result<(), StoreError> {
        self.verified.forget(digest);
        self.quarantine(&self.layout.object(digest)).map(|_| ())
    }
}

/// What is missing or damaged is a condition and no error.
fn condition(looked: Result<Condition, StoreError>) -> Result<Condition, StoreError> {
    match looked {
        Err(StoreError::Missing { .. }) => Ok(Condition::Missing),
        Err(StoreError::Damaged { reason, .. }) => Ok(Condition::Damaged(reason)),
        looked => looked,
    }
}
