//! Temporary files and folders beside outputs. Each is locked while its process lives, so that the next process that
//! writes in the same folder removes what a killed one has left.

use std::collections::BTreeSet;
use std::fs::{self, File, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use tempfile::{Builder, NamedTempFile, TempDir};

/// The start of the names; letters and digits follow.
const PREFIX: &str = ".deaflow-tmp-";

/// Number of letters and digits that follow.
const LETTERS: usize = 6;

/// Age below which nothing is removed: it may have been created and not be locked yet.
const SETTLED: Duration = Duration::from_secs(2);

/// A temporary folder beside an output, with the permissions of the umask; removed on drop.
pub struct TemporaryOutput {
    path: PathBuf,
    _folder: TempDir,
    _lock: Option<File>,
}

impl TemporaryOutput {
    /// Creates it in a folder, from which it removes what killed processes have left.
    ///
    /// # Errors
    /// When the system reports an error.
    pub fn inside(folder: &Path) -> io::Result<Self> {
        remove_abandoned(folder);
        let mut builder = Builder::new();
        let builder = builder.prefix(PREFIX).rand_bytes(LETTERS);
        let made = builder.permissions(Permissions::from_mode(0o777)).tempdir_in(folder)?;
        // A file system without locks keeps what killed processes leave.
        let lock = File::open(made.path()).ok().filter(|file| file.try_lock().is_ok());
        Ok(Self {
            // Relative if the folder is: HDF5 opens only paths in UTF-8.
            path: folder.join(made.path().file_name().unwrap_or_default()),
            _folder: made,
            _lock: lock,
        })
    }

    /// Returns its path, which begins with that of the folder that it is in.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Creates an empty file beside an output, with the permissions of the umask; removed on drop unless it is moved.
///
/// # Errors
/// When the system reports an error.
pub(super) fn temporary_output(folder: &Path) -> io::Result<NamedTempFile> {
    remove_abandoned(folder);
    let mut builder = Builder::new();
    let builder = builder.prefix(PREFIX).rand_bytes(LETTERS);
    let made = builder.permissions(Permissions::from_mode(0o666)).tempfile_in(folder)?;
    let _ = made.as_file().try_lock();
    Ok(made)
}

/// Removes what killed processes have left in a folder, once per process.
fn remove_abandoned(folder: &Path) {
    static SEARCHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    // The set is valid even after a panic.
    let mut searched = SEARCHED.lock().unwrap_or_else(PoisonError::into_inner);
    if searched.insert(folder.to_owned()) {
        search(folder);
    }
}

fn search(folder: &Path) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.for_each(|entry| remove_if_abandoned(&entry.path()));
}

fn remove_if_abandoned(path: &Path) {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let is_named = name.strip_prefix(PREFIX).is_some_and(|rest| rest.len() == LETTERS);
    let Some(metadata) = fs::symlink_metadata(path).ok().filter(|_| is_named) else {
        return;
    };
    let age = metadata
        .modified()
        .map(|written| SystemTime::now().duration_since(written));
    let is_settled = matches!(age, Ok(Ok(age)) if age >= SETTLED);
    if !is_settled || !(metadata.is_file() || metadata.is_dir()) {
        return;
    }
    // A living process holds the lock.
    if let Ok(file) = File::open(path)
        && file.try_lock().is_ok()
    {
        let _ = match metadata.is_dir() {
            true => fs::remove_dir_all(path),
            false => fs::remove_file(path),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn age(path: &Path) {
        let then = SystemTime::now() - 2 * SETTLED;
        File::open(path).unwrap().set_modified(then).unwrap();
    }

    #[test]
    fn what_a_killed_process_left_is_removed_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let living = TemporaryOutput::inside(folder.path()).unwrap();
        fs::write(living.path().join("part"), "1").unwrap();
        let written = temporary_output(folder.path()).unwrap();
        age(living.path());
        age(written.path());
        let (left, file, young) = (
            at(".deaflow-tmp-aaaaaa"),
            at(".deaflow-tmp-bbbbbb"),
            at(".deaflow-tmp-cccccc"),
        );
        fs::create_dir(&left).unwrap();
        for path in [
            &left.join("part"),
            &file,
            &at(".tmpabcdef"),
            &at(".deaflow-tmp-mine"),
            &young,
        ] {
            fs::write(path, "1").unwrap();
        }
        std::os::unix::fs::symlink("nothing", at(".deaflow-tmp-dddddd")).unwrap();
        for path in [&left, &file, &at(".tmpabcdef"), &at(".deaflow-tmp-mine")] {
            age(path);
        }
        let names = || {
            let names = fs::read_dir(folder.path()).unwrap();
            names
                .map(|entry| entry.unwrap().file_name().into_string().unwrap())
                .collect::<BTreeSet<_>>()
        };
        let before = names();
        // As another process does before it writes in this folder.
        search(folder.path());
        let gone: Vec<String> = before.difference(&names()).cloned().collect();
        assert_eq!(gone, [".deaflow-tmp-aaaaaa", ".deaflow-tmp-bbbbbb"]);
        assert!(names().is_subset(&before));
        drop((living, written));
        assert_eq!(names().len(), 4, "{:?}", names());
    }
}
