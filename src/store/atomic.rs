//! Files appear whole or not at all: written aside, synced, renamed into place, and their folder synced.
//!
//! The order is that of the usual crash-consistency argument (Pillai et al., OSDI 2014): without the first sync a name
//! may point to missing bytes after a crash, without the second the name itself may be lost.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::Path;

use super::delayed_names;
use super::error::StoreError;
use deaflow_base::folder_of;

/// Writes `bytes` as `target`, by way of the file `temporary` in the same filesystem.
///
/// # Errors
/// When the system refuses; nothing is visible as `target` then.
pub fn write(temporary: &Path, target: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    write_unsettled(temporary, target, bytes)?;
    sync_folder(folder_of(target))
}

/// As [`write()`], but a crash of the machine may yet lose the name: the folder has still to be synced.
///
/// # Errors
/// As [`write()`].
pub fn write_unsettled(temporary: &Path, target: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let refused = |error| StoreError::io("write", target)(error);
    let mut file = File::create(temporary).map_err(refused)?;
    file.write_all(bytes).map_err(refused)?;
    // Bytes and length; the times of the file may be lost.
    file.sync_data().map_err(refused)?;
    drop(file);
    place(temporary, target)
}

/// Gives a synced file its name, creating the folder, unless something of that name is there; says whether it was given. It keeps no
/// other name.
///
/// # Errors
/// When the system refuses.
pub fn link(temporary: &Path, target: &Path) -> Result<bool, StoreError> {
    make_folder_of(target)?;
    match delayed_names::until_seen(|| fs::hard_link(temporary, target)) {
        Ok(()) => {
            // What is left under the other name goes with its folder.
            let _ = fs::remove_file(temporary);
        }
        Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(false),
        // No file system of two names: then none where the locks are not to be trusted either.
        Err(error) if is_unknown(&error) => {
            if fs::symlink_metadata(target).is_ok() {
                return Ok(false);
            }
            fs::rename(temporary, target).map_err(StoreError::io("write", target))?;
        }
        Err(error) => return Err(StoreError::io("write", target)(error)),
    }
    sync_folder(folder_of(target))?;
    Ok(true)
}

/// Whether the system does not know how to give a file two names here (FAT, some FUSE file systems).
fn is_unknown(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::Unsupported | ErrorKind::PermissionDenied)
}

/// Moves a synced file into place, creating its folder.
///
/// # Errors
/// When the system refuses.
pub fn rename(temporary: &Path, target: &Path) -> Result<(), StoreError> {
    place(temporary, target)?;
    sync_folder(folder_of(target))
}

fn place(temporary: &Path, target: &Path) -> Result<(), StoreError> {
    make_folder_of(target)?;
    delayed_names::until_seen(|| fs::rename(temporary, target)).map_err(StoreError::io("write", target))
}

fn make_folder_of(target: &Path) -> Result<(), StoreError> {
    let folder = folder_of(target);
    if !folder.is_dir() {
        delayed_names::make_folders(folder).map_err(StoreError::io("create", folder))?;
        sync_folder(folder_of(folder))?;
    }
    Ok(())
}

/// Makes the names in a folder survive a crash of the machine.
///
/// # Errors
/// When the system refuses.
pub fn sync_folder(folder: &Path) -> Result<(), StoreError> {
    File::open(folder)
        .and_then(|f| f.sync_all())
        .map_err(StoreError::io("sync", folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_moved_into_place_and_not_copied() {
        use std::os::unix::fs::MetadataExt;
        let folder = tempfile::tempdir().unwrap();
        let (aside, target) = (folder.path().join("aside"), folder.path().join("deep/er/target"));
        fs::write(&aside, "content").unwrap();
        let inode = fs::metadata(&aside).unwrap().ino();
        rename(&aside, &target).unwrap();
        // The same file under its new name: no moment at which half of it could be seen.
        assert_eq!(fs::metadata(&target).unwrap().ino(), inode);
        assert!(!aside.exists());
        write(&aside, &target, b"more").unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"more");
        assert!(!aside.exists());
    }
}
