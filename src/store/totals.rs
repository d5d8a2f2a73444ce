//! What is in a store, counted and weighed without reading it.

use std::fs;

use super::error::StoreError;
use super::layout::{files, files_in};
use super::lock;
use super::open::Store;
/// What is in a store.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// Artifacts.
    pub objects: u64,
    /// Length of their files, bytes.
    pub bytes: u64,
    /// Records.
    pub records: u64,
    /// Unfinished actions that can be gone on with.
    pub checkpoints: u64,
    /// Length of their files, bytes.
    pub checkpoint_bytes: u64,
    /// Pinned artifacts.
    pub pins: u64,
    /// Lock files that are remembered.
    pub lock_files: u64,
    /// Damaged files that were moved aside.
    pub quarantined: u64,
    /// Actions that some process is at work on.
    pub in_flight: u64,
}

impl Store {
    /// Counts and weighs.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn totals(&self) -> Result<Totals, StoreError> {
        let mut totals = Totals {
            records: files(&self.layout.records())?.len() as u64,
            pins: count(&self.layout.pins())?,
            lock_files: count(&self.layout.lock_files())?,
            quarantined: count(&self.layout.quarantine())?,
            ..Totals::default()
        };
        for path in files(&self.layout.objects())? {
            // Another process may have just replaced it.
            if let Ok(metadata) = fs::metadata(&path) {
                totals.objects += 1;
                totals.bytes += metadata.len();
            }
        }
        for checkpoints in self.checkpoints()?.iter().filter(|checkpoints| checkpoints.size > 0) {
            totals.checkpoints += 1;
            totals.checkpoint_bytes += checkpoints.size;
        }
        for path in files_in(&self.layout.action_locks())? {
            totals.in_flight += u64::from(lock::is_held(&path)?);
        }
        Ok(totals)
    }
}

fn count(folder: &std::path::Path) -> Result<u64, StoreError> {
    match folder.is_dir() {
        true => Ok(files_in(folder)?.len() as u64),
        false => Ok(0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ActionKey;
    use crate::store::{Object, Pin, Provenance};

    #[test]
    fn everything_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        assert_eq!(store.totals().unwrap(), Totals::default());
        let object = Object::default().attribute("a", "b");
        let stored = store.put(&object, &Provenance::default()).unwrap();
        let (label, created) = (String::new(), String::new());
        let digest = stored.digest;
        store.pin(&Pin { digest, label, created }).unwrap();
        fs::write(store.layout.quarantine().join("x"), "").unwrap();
        let key = ActionKey::of(b"key");
        let held = store.lock_action(&key).unwrap();
        let expected = Totals {
            objects: 1,
            bytes: stored.size,
            pins: 1,
            quarantined: 1,
            in_flight: 1,
            ..Totals::default()
        };
        assert_eq!(store.totals().unwrap(), expected);
        drop(held);
        assert_eq!(store.totals().unwrap().in_flight, 0);
    }
}
