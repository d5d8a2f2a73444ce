//! Which files have been verified in this process, so that each is digested once.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::SystemTime;

use super::error::StoreError;
use super::seal::Seal;
use crate::base::Digest;

/// What shows that a file has been written again.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Stamp {
    size: u64,
    modified: Option<SystemTime>,
}

/// The memory of verified files.
#[derive(Default)]
pub struct Verified(Mutex<HashMap<PathBuf, (Stamp, Seal)>>);

impl Verified {
    /// Verifies every byte of the file of an artifact, unless this process has done so and the file is as it was.
    ///
    /// # Errors
    /// When it is missing, damaged, or another artifact.
    pub fn verify(&self, path: &Path, digest: &Digest) -> Result<Seal, StoreError> {
        let stamp = stamp(path, digest)?;
        if let Some(seal) = self.known(path, stamp) {
            return named(path, digest, seal);
        }
        let seal = named(path, digest, Seal::verify(path)?)?;
        self.lock().insert(path.to_owned(), (stamp, seal));
        Ok(seal)
    }

    /// Compares the seal's name and length with the file, without digesting its bytes.
    ///
    /// # Errors
    /// When it is missing, another artifact, or of another length.
    pub fn glance(&self, path: &Path, digest: &Digest) -> Result<Seal, StoreError> {
        let stamp = stamp(path, digest)?;
        match self.known(path, stamp) {
            Some(seal) => named(path, digest, seal),
            None => named(path, digest, Seal::read(path)?),
        }
    }

    /// Takes note of a file that this process has just written.
    pub fn remember(&self, path: &Path, seal: Seal) {
        if let Ok(stamp) = stamp(path, &seal.content) {
            self.lock().insert(path.to_owned(), (stamp, seal));
        }
    }

    fn known(&self, path: &Path, stamp: Stamp) -> Option<Seal> {
        let known = self.lock();
        let (then, seal) = known.get(path)?;
        (*then == stamp).then_some(*seal)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<PathBuf, (Stamp, Seal)>> {
        // A panic elsewhere while the map was held leaves it whole: entries are inserted in one step.
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

fn stamp(path: &Path, digest: &Digest) -> Result<Stamp, StoreError> {
    match fs::metadata(path) {
        Ok(metadata) => Ok(Stamp {
            size: metadata.len(),
            modified: metadata.modified().ok(),
        }),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Err(StoreError::Missing {
            digest: *digest,
            path: path.to_owned(),
        }),
        Err(error) => Err(StoreError::io("read", path)(error)),
    }
}

fn named(path: &Path, digest: &Digest, seal: Seal) -> Result<Seal, StoreError> {
    if seal.content == *digest {
        Ok(seal)
    } else {
        let reason = format!("it holds artifact {}", seal.content.short());
        Err(StoreError::damaged(path, reason))
    }
}
