//! Notes that processes of several machines leave for each other: `cluster/<topic>/<name>`.
//!
//! They are no truth of their own: no key, no artifact and no record depends on one, and any may be deleted at any time.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::atomic;
use super::delayed_names;
use super::entries::{files_in_optional, is_file};
use super::error::StoreError;
use super::layout::CLUSTER;
use super::lock::Guard;
use super::open::Store;
use deaflow_base::{folder_of, read_own};

/// A note is shorter, bytes.
const LONGEST: u64 = 16 << 20;

/// The file that who leads holds.
const LEAD: &str = "lead";

/// The notes on one topic.
#[derive(Clone)]
pub struct Board {
    store: Store,
    topic: String,
    folder: PathBuf,
}

impl Store {
    /// The notes on a topic: letters, digits, `-` and `_`. Nothing is made before something is written.
    #[must_use]
    pub fn board(&self, topic: &str) -> Board {
        Board {
            store: self.clone(),
            topic: topic.to_owned(),
            folder: self.root().join(CLUSTER).join(topic),
        }
    }
}

impl Board {
    fn make(&self, folder: &Path) -> Result<(), StoreError> {
        self.store.clear_folder(folder)?;
        delayed_names::make_folders(folder).map_err(StoreError::io("create", folder))
    }

    fn make_folder(&self) -> Result<(), StoreError> {
        self.make(folder_of(&self.folder))?;
        self.make(&self.folder)
    }

    /// The folder of logs beside the notes, which is made where there is none.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn logs(&self) -> Result<PathBuf, StoreError> {
        self.make_folder()?;
        let logs = self.folder.join("logs");
        self.make(&logs)?;
        Ok(logs)
    }

    /// Writes a note in place of the one of that name.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn write<T: Serialize>(&self, name: &str, note: &T) -> Result<(), StoreError> {
        let text = serde_json::to_vec(note)?;
        self.make_folder()?;
        let temporary = self.store.temporary_file()?;
        atomic::write(&temporary, &self.folder.join(name), &text)
    }

    /// Reads a note; none where there is none.
    ///
    /// # Errors
    /// When the system refuses, or it is not understood: another version may have written it.
    pub fn read<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>, StoreError> {
        let path = self.folder.join(name);
        let bytes = match read_own(&path, LONGEST) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            bytes => bytes.map_err(StoreError::io("read", &path))?,
        };
        let note = serde_json::from_slice(&bytes);
        note.map(Some)
            .map_err(|error| StoreError::damaged(&path, format!("it is no note of this version: {error}")))
    }

    /// Whether a note is there and was written by the user of this process.
    #[must_use]
    pub fn is_own(&self, name: &str) -> bool {
        let written = fs::symlink_metadata(self.folder.join(name));
        written.is_ok_and(|written| written.uid() == rustix::process::getuid().as_raw())
    }

    /// Whether there is a note of that name. Its folder is asked, which knows of what other machines have just written.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        let names = self.names(name);
        names.is_ok_and(|names| names.iter().any(|found| found == name))
    }

    /// Removes a note; one that is gone is none.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn remove(&self, name: &str) -> Result<(), StoreError> {
        let path = self.folder.join(name);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(StoreError::io("remove", &path)(error)),
            _ => Ok(()),
        }
    }

    /// Names of the notes that begin so, in order.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn names(&self, prefix: &str) -> Result<Vec<String>, StoreError> {
        let name = |path: &PathBuf| Some(path.file_name()?.to_str()?.to_owned());
        let found = files_in_optional(&self.folder)?.into_iter();
        let named = found.filter_map(|path| Some((name(&path)?, path)));
        let meant = named.filter(|(name, path)| name.starts_with(prefix) && is_file(path));
        Ok(meant.map(|(name, _)| name).collect())
    }

    /// How long before `now` a note was written; both are by the clock of the file system ([`Store::now`]).
    #[must_use]
    pub fn age(&self, name: &str, now: SystemTime) -> Option<Duration> {
        let written = fs::symlink_metadata(self.folder.join(name)).ok()?.modified().ok()?;
        Some(now.duration_since(written).unwrap_or_default())
    }

    /// The right to act on the topic, which one process has at a time; none where another has it.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn try_lock(&self) -> Result<Option<Guard>, StoreError> {
        self.make_folder()?;
        let name = format!("{LEAD}-{}", self.topic);
        self.store.session.try_named(&self.folder.join(LEAD), &name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_note_is_there_for_others_until_it_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let one = Store::open(folder.path()).unwrap().board("topic");
        let two = Store::open(folder.path()).unwrap().board("topic");
        assert_eq!(two.read::<u32>("note").unwrap(), None);
        one.write("note", &1_u32).unwrap();
        one.write("note", &2_u32).unwrap();
        one.write("other", &3_u32).unwrap();
        assert_eq!(
            (two.read("note").unwrap(), two.names("no").unwrap()),
            (Some(2_u32), vec!["note".to_owned()])
        );
        assert!(two.age("note", two.store.now()).unwrap() < Duration::from_secs(60));
        assert!(two.has("note") && !two.has("no"));
        assert!(
            two.read::<String>("note").is_err(),
            "what is not understood is not taken for none"
        );
        assert!(two.is_own("note") && !two.is_own("no"));
        two.remove("note").unwrap();
        two.remove("note").unwrap();
        assert_eq!(
            (one.read::<u32>("note").unwrap(), one.age("note", one.store.now())),
            (None, None)
        );
        let left = fs::read_dir(folder.path().join("tmp")).unwrap().flatten();
        let left = left.flat_map(|own| fs::read_dir(own.path()).unwrap());
        assert_eq!(left.count(), 0, "nothing is left of writing");
    }

    #[test]
    fn one_leads_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let board = |topic| Store::open(folder.path()).unwrap().board(topic);
        let lead = board("topic").try_lock().unwrap();
        assert!(lead.is_some() && board("topic").try_lock().unwrap().is_none());
        assert!(board("other").try_lock().unwrap().is_some());
        drop(lead);
        assert!(board("topic").try_lock().unwrap().is_some());
    }
}
