//! Counts the files of a store and their lengths.

use std::fs;
use std::path::PathBuf;

use super::entries::{files, files_in, files_in_optional};
use super::error::StoreError;
use super::lock;
use super::open::Store;

/// Numbers and lengths of the files of a store.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// Artifacts.
    pub objects: u64,
    /// Length of their files, bytes.
    pub bytes: u64,
    /// Records.
    pub records: u64,
    /// Unfinished actions with checkpoints.
    pub checkpoints: u64,
    /// Length of their files, bytes.
    pub checkpoint_bytes: u64,
    /// Pinned artifacts.
    pub pins: u64,
    /// Registered lock files.
    pub lock_files: u64,
    /// Files in quarantine.
    pub quarantined: u64,
    /// Actions that are running.
    pub in_flight: u64,
}

impl Store {
    /// Counts the files and their lengths.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn totals(&self) -> Result<Totals, StoreError> {
        let mut totals = Totals {
            records: count(files(&self.layout.records())?, |path| {
                self.layout.action_at(path).is_some()
            }),
            pins: self.pins()?.len() as u64,
            lock_files: self.remembered_lock_files()?.len() as u64,
            quarantined: files_in(&self.layout.quarantine())?.len() as u64,
            ..Totals::default()
        };
        let objects = files(&self.layout.objects())?;
        for path in objects.iter().filter(|path| self.layout.artifact_at(path).is_some()) {
            // Another process may have just replaced it.
            if let Ok(metadata) = fs::symlink_metadata(path) {
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
        for path in files_in_optional(&self.layout.claims())? {
            totals.in_flight += u64::from(path.file_name().is_some_and(|name| name.len() == 64));
        }
        Ok(totals)
    }
}

fn count(paths: Vec<PathBuf>, is_ours: impl Fn(&PathBuf) -> bool) -> u64 {
    paths.iter().filter(|path| is_ours(path)).count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Object, Pin, Provenance};
    use deaflow_base::ActionKey;

    #[test]
    fn everything_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        assert_eq!(store.totals().unwrap(), Totals::default());
        let object = Object::default().attribute("a", "b");
        let stored = store.put(&object, &Provenance::default()).unwrap();
        let (label, created) = (String::new(), String::new());
        let digest = stored.digest;
        let result_only = false;
        store
            .pin(&Pin {
                digest,
                label,
                created,
                result_only,
            })
            .unwrap();
        fs::write(store.layout.quarantine().join("x"), "").unwrap();
        let key = ActionKey::of(b"key");
        let held = store.try_lock_action(&key).unwrap().unwrap();
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
