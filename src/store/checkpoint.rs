//! Checkpoints of unfinished actions, from which killed work is resumed.
//!
//! A checkpoint is not an artifact: it is only used to resume its own action, by the build that wrote it, and is
//! removed when the action is recorded. It has a checksum, because work that is resumed from damaged data would make a
//! wrong artifact.
//!
//! ```text
//! deaflow-checkpoint 2
//! <BLAKE3 of all that follows>
//! <action key>
//! <name>
//! <build>
//! <progress, as JSON>
//! content
//! ```

use std::fs;
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use super::atomic;
use super::entries::{files_in_optional, is_folder, is_hidden};
use super::error::StoreError;
use super::open::Store;
use deaflow_base::{ActionKey, Digest, open_own};

const TITLE: &str = "deaflow-checkpoint 2";

/// The title of the version without progress.
const FIRST_TITLE: &str = "deaflow-checkpoint 1";

/// The progress of an unfinished action.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CheckpointProgress {
    /// Its stage.
    pub stage: String,
    /// Number of finished steps.
    pub steps: u64,
    /// Unit of the steps: "epochs".
    pub unit: String,
}

/// The checkpoints of one action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoints {
    /// The action.
    pub key: ActionKey,
    /// Their folder.
    pub path: PathBuf,
    /// Total length of their files, bytes.
    pub size: u64,
    /// When one of them was last written or removed, if known.
    pub written: Option<SystemTime>,
    /// Their progress, if it can be read.
    pub progress: Option<CheckpointProgress>,
}

impl Checkpoints {
    /// Whether the last is younger than `grace`. A time in the future also counts as young: the clock has been set
    /// back.
    pub(super) fn is_young(&self, grace: Duration, now: SystemTime) -> bool {
        let age = self.written.and_then(|written| now.duration_since(written).ok());
        age.is_none_or(|age| age < grace)
    }
}

impl Store {
    /// Writes a checkpoint of an action under a name, replacing the previous one. `build` identifies the builds that
    /// can resume it, in one line.
    ///
    /// # Errors
    /// If the system reports an error (disk full); the previous checkpoint stays then.
    pub fn put_checkpoint(
        &self,
        key: &ActionKey,
        name: &str,
        build: &str,
        reached: &CheckpointProgress,
        content: &[u8],
    ) -> Result<(), StoreError> {
        let reached = serde_json::to_string(reached)?;
        let body = [origin(key, name, build).as_bytes(), reached.as_bytes(), b"\n", content].concat();
        let head = format!("{TITLE}\n{}\n", Digest::of(&body));
        let temporary = self.temporary_file()?;
        let folder = self.layout.checkpoints_of(key);
        self.clear_folder(&folder)?;
        let target = folder.join(name);
        atomic::write(&temporary, &target, &[head.as_bytes(), &body].concat())
    }

    /// Returns the content of a checkpoint; `None` if there is none.
    ///
    /// # Errors
    /// If it is damaged, or of another action or build ([`StoreError::Damaged`]), or the system reports an error.
    pub fn checkpoint(&self, key: &ActionKey, name: &str, build: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let path = self.layout.checkpoints_of(key).join(name);
        let Some(body) = body(&path)? else { return Ok(None) };
        let origin = origin(key, name, build);
        let rest = body.strip_prefix(origin.as_bytes());
        let content = rest.and_then(|rest| rest.splitn(2, |byte| *byte == b'\n').nth(1));
        match content {
            Some(content) => Ok(Some(content.to_vec())),
            None => Err(StoreError::damaged(
                &path,
                "it was written by another build or for another action",
            )),
        }
    }

    /// Returns the progress of an action that the same build can resume, if any.
    #[must_use]
    pub fn checkpoint_progress(&self, key: &ActionKey, build: &str) -> Option<CheckpointProgress> {
        let files = files_in_optional(&self.layout.checkpoints_of(key)).ok()?;
        let (wrote, reached) = files.iter().find_map(|path| head(path))?;
        (wrote == one_line(build)).then_some(reached)
    }

    /// Removes all checkpoints of an action.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn remove_checkpoints(&self, key: &ActionKey) -> Result<(), StoreError> {
        remove(&self.layout.checkpoints_of(key))
    }

    /// Returns the checkpoints of all actions.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn checkpoints(&self) -> Result<Vec<Checkpoints>, StoreError> {
        let folders = files_in_optional(&self.layout.checkpoints())?;
        let found = folders.into_iter().filter_map(|path| Some((key_of(&path)?, path)));
        found.map(|(key, path)| measure(key, path)).collect()
    }

    /// Returns the files of all checkpoints, and stray files.
    pub(super) fn checkpoint_files(&self) -> Result<(Vec<PathBuf>, Vec<PathBuf>), StoreError> {
        let (mut files, mut strays) = (Vec::new(), Vec::new());
        for path in files_in_optional(&self.layout.checkpoints())? {
            match key_of(&path) {
                // Another process may just have finished its work.
                Some(_) => files.extend(files_in_optional(&path)?),
                None if is_hidden(&path) => {}
                None => strays.push(path),
            }
        }
        Ok((files, strays))
    }
}

/// Checks that the file of a checkpoint is intact or missing.
///
/// # Errors
/// If it is damaged, or the system reports an error.
pub(super) fn check(path: &Path) -> Result<(), StoreError> {
    body(path).map(|_| ())
}

/// Removes a folder of checkpoints. Does nothing if there is none, or if it is a link.
///
/// # Errors
/// If the system reports an error.
pub(super) fn remove(folder: &Path) -> Result<(), StoreError> {
    if !is_folder(folder) {
        return Ok(());
    }
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(StoreError::io("remove", folder)(error)),
        _ => Ok(()),
    }
}

fn origin(key: &ActionKey, name: &str, build: &str) -> String {
    format!("{key}\n{name}\n{}\n", one_line(build))
}

fn one_line(text: &str) -> String {
    text.replace('\n', " ")
}

/// Returns the build that wrote a checkpoint, and its progress. They are only shown and used for estimates, so the
/// digest is not verified.
fn head(path: &Path) -> Option<(String, CheckpointProgress)> {
    let file = BufReader::new(open_own(path).ok()?);
    let mut lines = std::io::Read::take(file, LONGEST_HEAD).lines().map_while(Result::ok);
    if lines.next()? != TITLE {
        return None;
    }
    // After the digest, the key and the name.
    let build = lines.nth(3)?;
    Some((build, serde_json::from_str(&lines.next()?).ok()?))
}

/// Maximum length of everything before the content, bytes.
const LONGEST_HEAD: u64 = 1 << 16;

/// Returns everything that the digest covers; `None` if there is no file.
fn body(path: &Path) -> Result<Option<Vec<u8>>, StoreError> {
    let mut bytes = Vec::new();
    let read = open_own(path).and_then(|mut file| std::io::Read::read_to_end(&mut file, &mut bytes));
    match read {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) if error.kind() == ErrorKind::InvalidInput => {
            return Err(StoreError::damaged(path, "it is not a file"));
        }
        read => read.map_err(StoreError::io("read", path))?,
    };
    let titled = [TITLE, FIRST_TITLE];
    let checked = titled
        .iter()
        .find_map(|title| bytes.strip_prefix(format!("{title}\n").as_bytes()))
        .and_then(|rest| rest.split_at_checked(65));
    match checked {
        Some((digest, body)) if digest == format!("{}\n", Digest::of(body)).as_bytes() => Ok(Some(body.to_vec())),
        _ => Err(StoreError::damaged(path, "its bytes have changed")),
    }
}

fn key_of(path: &Path) -> Option<ActionKey> {
    path.file_name()?.to_str()?.parse().ok().filter(|_| is_folder(path))
}

fn measure(key: ActionKey, path: PathBuf) -> Result<Checkpoints, StoreError> {
    let mut checkpoints = Checkpoints {
        key,
        size: 0,
        progress: None,
        written: fs::metadata(&path).and_then(|metadata| metadata.modified()).ok(),
        path,
    };
    for file in files_in_optional(&checkpoints.path)? {
        // It may be replaced at this moment.
        if let Ok(metadata) = fs::symlink_metadata(&file) {
            checkpoints.size += metadata.len();
            checkpoints.written = checkpoints.written.max(metadata.modified().ok());
            checkpoints.progress = checkpoints.progress.or_else(|| Some(head(&file)?.1));
        }
    }
    Ok(checkpoints)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Retention;
    use crate::entries::files;

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        (folder, store)
    }

    #[test]
    fn what_was_kept_last_is_found_until_it_is_removed() {
        let (_folder, store) = store();
        let (key, other) = (ActionKey::of(b"key"), ActionKey::of(b"other"));
        assert_eq!(store.checkpoint(&key, "state", "b").unwrap(), None);
        let reached = CheckpointProgress {
            stage: "a\nb".into(),
            steps: 7,
            unit: "epochs".into(),
        };
        for content in [&b"first"[..], b"second\nwith lines\n", b""] {
            store.put_checkpoint(&key, "state", "b", &reached, content).unwrap();
            assert_eq!(store.checkpoint(&key, "state", "b").unwrap().as_deref(), Some(content));
        }
        // How far it has come is known to the build that can go on with it, and to whoever lists them.
        assert_eq!(store.checkpoint_progress(&key, "b"), Some(reached.clone()));
        assert_eq!(
            (
                store.checkpoint_progress(&key, "c"),
                store.checkpoint_progress(&other, "b")
            ),
            (None, None)
        );
        assert_eq!(store.checkpoints().unwrap()[0].progress, Some(reached));
        assert_eq!(store.checkpoint(&key, "more", "b").unwrap(), None);
        assert_eq!(store.checkpoint(&other, "state", "b").unwrap(), None);
        store
            .put_checkpoint(&other, "state", "b", &CheckpointProgress::default(), b"1234")
            .unwrap();
        let found: Vec<ActionKey> = store.checkpoints().unwrap().into_iter().map(|c| c.key).collect();
        assert!(found.len() == 2 && found.contains(&key) && found.contains(&other));
        store.remove_checkpoints(&key).unwrap();
        store.remove_checkpoints(&key).unwrap();
        assert_eq!(store.checkpoint(&key, "state", "b").unwrap(), None);
        assert!(files(&store.layout.temporary()).unwrap().is_empty());
    }

    #[test]
    fn every_flipped_byte_is_noticed_and_so_is_the_work_of_others() {
        let (_folder, store) = store();
        let (key, other) = (ActionKey::of(b"key"), ActionKey::of(b"other"));
        store
            .put_checkpoint(&key, "state", "build 1", &CheckpointProgress::default(), b"content")
            .unwrap();
        let path = store.layout.checkpoints_of(&key).join("state");
        let bytes = fs::read(&path).unwrap();
        let refused = |key: &ActionKey, name: &str, build: &str| {
            let found = store.checkpoint(key, name, build);
            matches!(found, Err(StoreError::Damaged { .. }))
        };
        for at in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1;
            fs::write(&path, flipped).unwrap();
            assert!(refused(&key, "state", "build 1"), "byte {at}");
            fs::write(&path, &bytes[..at]).unwrap();
            assert!(refused(&key, "state", "build 1"), "{at} bytes");
        }
        fs::write(&path, &bytes).unwrap();
        assert!(refused(&key, "state", "build 2"));
        fs::create_dir_all(store.layout.checkpoints_of(&other)).unwrap();
        fs::copy(&path, store.layout.checkpoints_of(&other).join("state")).unwrap();
        fs::copy(&path, path.with_file_name("more")).unwrap();
        assert!(refused(&other, "state", "build 1") && refused(&key, "more", "build 1"));
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert!(refused(&key, "state", "build 1"));
    }

    #[test]
    fn the_check_of_the_store_finds_damaged_ones_and_collection_takes_old_ones() {
        let (folder, store) = store();
        let [sound, damaged] = [b"1", b"2"].map(|k| ActionKey::of(k));
        for key in [&sound, &damaged] {
            store
                .put_checkpoint(key, "state", "b", &CheckpointProgress::default(), b"content")
                .unwrap();
        }
        let file = |key| store.layout.checkpoints_of(key).join("state");
        fs::write(file(&damaged), "something").unwrap();
        fs::write(store.layout.checkpoints().join("note.txt"), "mine").unwrap();
        let report = store.fsck(&|_, _| ()).unwrap();
        assert_eq!(
            (report.checkpoints, report.damaged.len(), report.strays.len()),
            (2, 1, 1)
        );
        assert!(!file(&damaged).exists() && file(&sound).exists());
        let totals = store.totals().unwrap();
        assert_eq!(
            (totals.checkpoints, totals.checkpoint_bytes),
            (1, fs::metadata(file(&sound)).unwrap().len())
        );
        drop(store);

        let store = Store::open_exclusive(folder.path()).unwrap();
        let hour = Duration::from_secs(3600);
        let retention = Retention {
            runs: 1,
            grace: hour,
            free: None,
        };
        let now = SystemTime::now();
        assert!(store.plan_gc(&retention, now).unwrap().checkpoints.is_empty());
        let later = store.plan_gc(&retention, now + 2 * hour).unwrap();
        let going: Vec<ActionKey> = later.checkpoints.iter().map(|c| c.key).collect();
        assert!(going.contains(&sound));
        store.remove(&later, "", &|_, _| ()).unwrap();
        assert!(store.checkpoints().unwrap().is_empty());
    }
}
