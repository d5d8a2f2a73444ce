//! Notes between processes on several machines: `cluster/<topic>/<name>`.
//!
//! No key, artifact or record depends on a note, and each may be deleted at any time.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::atomic;
use super::delayed_names;
use super::entries::{files_in_optional, is_file, remove_file};
use super::error::StoreError;
use super::layout::CLUSTER;
use super::lock::Guard;
use super::open::Store;
use deaflow_base::{folder_of, read_own};

/// Maximum length of a note, bytes.
const LONGEST: u64 = 16 << 20;

/// The file that the leading process locks.
const LEAD: &str = "lead";

/// The notes on one topic.
#[derive(Clone)]
pub struct Board {
    store: Store,
    topic: String,
    folder: PathBuf,
}

impl Store {
    /// Returns the notes on a topic (letters, digits, `-` and `_`). Folders are created on the first write.
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

    /// Returns the folder for logs, which is created if missing.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn logs(&self) -> Result<PathBuf, StoreError> {
        self.make_folder()?;
        let logs = self.folder.join("logs");
        self.make(&logs)?;
        Ok(logs)
    }

    /// Writes a note, replacing one of the same name.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn write<T: Serialize>(&self, name: &str, note: &T) -> Result<(), StoreError> {
        let text = serde_json::to_vec(note)?;
        self.make_folder()?;
        let temporary = self.store.temporary_file()?;
        atomic::write(&temporary, &self.folder.join(name), &text)
    }

    /// Reads a note; returns `None` if there is none.
    ///
    /// # Errors
    /// If the system reports an error, or the note is not valid: another version may have written it.
    pub fn read<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>, StoreError> {
        let path = self.folder.join(name);
        let bytes = match read_own(&path, LONGEST) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            bytes => bytes.map_err(StoreError::io("read", &path))?,
        };
        let note = serde_json::from_slice(&bytes);
        note.map(Some)
            .map_err(|error| StoreError::damaged(&path, format!("it is not a valid note of this version: {error}")))
    }

    /// Whether a note exists and was written by the user of this process.
    #[must_use]
    pub fn is_own(&self, name: &str) -> bool {
        let written = fs::symlink_metadata(self.folder.join(name));
        written.is_ok_and(|written| written.uid() == rustix::process::getuid().as_raw())
    }

    /// Whether there is a note of that name. Lists the folder, which shows what other machines have just written.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        let names = self.names(name);
        names.is_ok_and(|names| names.iter().any(|found| found == name))
    }

    /// Removes a note if it exists.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn remove(&self, name: &str) -> Result<(), StoreError> {
        remove_file(&self.folder.join(name))
    }

    /// Returns the names of notes with this prefix, sorted.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn names(&self, prefix: &str) -> Result<Vec<String>, StoreError> {
        let name = |path: &PathBuf| Some(path.file_name()?.to_str()?.to_owned());
        let found = files_in_optional(&self.folder)?.into_iter();
        let named = found.filter_map(|path| Some((name(&path)?, path)));
        let meant = named.filter(|(name, path)| name.starts_with(prefix) && is_file(path));
        Ok(meant.map(|(name, _)| name).collect())
    }

    /// Returns the age of a note at `now`, both by the clock of the file system ([`Store::now`]).
    #[must_use]
    pub fn age(&self, name: &str, now: SystemTime) -> Option<Duration> {
        let written = fs::symlink_metadata(self.folder.join(name)).ok()?.modified().ok()?;
        Some(now.duration_since(written).unwrap_or_default())
    }

    /// Locks the topic, unless another process has it.
    ///
    /// # Errors
    /// If the system reports an error.
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
