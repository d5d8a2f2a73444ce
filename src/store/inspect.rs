//! Whether an artifact is there and whole, at a cost that suits the occasion.
//!
//! Planning must notice a missing or damaged artifact and yet take less than a second over a store of gigabytes. So it
//! digests in full what is suspicious (written after the record that vouches for it) and what is small, up to a budget;
//! of the rest it compares seal and length. Whatever is read as an input is verified in full, and so is all by `fsck`.

use std::fs;
use std::path::Path;
use std::time::SystemTime;

use super::error::StoreError;
use super::open::Store;
use super::read;
use crate::base::Digest;

/// A file longer than this is digested while planning only if it is suspicious, bytes.
const SMALL: u64 = 16 << 20;

/// How many bytes one plan digests for good measure.
const BUDGET: u64 = 256 << 20;

/// State of an artifact.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Condition {
    /// As it was written, as far as was looked.
    Intact {
        /// Length of the file in bytes.
        size: u64,
    },
    /// There is no file.
    Missing,
    /// The file is not what was written; why.
    Damaged(String),
}

/// How much to look at, and what has been spent.
#[derive(Debug)]
pub struct Effort {
    thorough: bool,
    budget: u64,
}

impl Effort {
    /// Small and suspicious files in full, up to a budget.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            thorough: false,
            budget: BUDGET,
        }
    }

    /// Every byte.
    #[must_use]
    pub fn thorough() -> Self {
        Self {
            thorough: true,
            budget: 0,
        }
    }

    fn in_full(&mut self, size: u64, suspicious: bool) -> bool {
        let affordable = size <= SMALL && size <= self.budget;
        if affordable {
            self.budget -= size;
        }
        self.thorough || suspicious || affordable
    }
}

impl Store {
    /// The condition of one artifact file (not of a manifest's chunks). `vouched` is when the record that names it was
    /// written.
    ///
    /// # Errors
    /// When the system refuses, for instance for want of permission.
    pub fn inspect(&self, digest: &Digest, vouched: SystemTime, effort: &mut Effort) -> Result<Condition, StoreError> {
        let path = self.layout.object(digest);
        let looked = self.verified.glance(&path, digest).and_then(|seal| {
            if effort.in_full(seal.size, written_after(&path, vouched)) {
                self.verified.verify(&path, digest)?;
            }
            Ok(seal.size)
        });
        match looked {
            Ok(size) => Ok(Condition::Intact { size }),
            Err(StoreError::Missing { .. }) => Ok(Condition::Missing),
            Err(StoreError::Damaged { reason, .. }) => Ok(Condition::Damaged(reason)),
            Err(error) => Err(error),
        }
    }

    /// The chunks of a manifest that is known to be intact.
    ///
    /// # Errors
    /// When it has become unreadable since.
    pub fn parts(&self, digest: &Digest) -> Result<Vec<Digest>, StoreError> {
        let path = self.layout.object(digest);
        self.verified.verify(&path, digest)?;
        Ok(read::header(&path)?.parts)
    }

    /// Moves an artifact's file aside.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn quarantine_artifact(&self, digest: &Digest) -> Result<(), StoreError> {
        self.quarantine(&self.layout.object(digest)).map(|_| ())
    }
}

/// A time that cannot be had is suspicious too.
fn written_after(path: &Path, vouched: SystemTime) -> bool {
    let modified = fs::metadata(path).and_then(|metadata| metadata.modified());
    modified.map_or(true, |modified| modified > vouched)
}
