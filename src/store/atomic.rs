//! Writes files atomically: to a temporary file, which is synced and renamed, and then syncs the folder.
//!
//! For the order of these steps see Pillai et al., OSDI 2014: without the first sync a name may refer to missing bytes
//! after a crash, without the second the name itself may be lost.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::Path;

use super::delayed_names;
use super::error::StoreError;
use deaflow_base::folder_of;

/// Writes `bytes` to `target` by way of `temporary` in the same file system.
///
/// # Errors
/// If the system reports an error; `target` is unchanged then.
pub fn write(temporary: &Path, target: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    write_unsettled(temporary, target, bytes)?;
    sync_folder(folder_of(target))
}

/// As [`write()`] without syncing the folder: a crash of the machine may lose the name.
///
/// # Errors
/// As [`write()`].
pub fn write_unsettled(temporary: &Path, target: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let refused = |error| StoreError::io("write", target)(error);
    let mut file = File::create(temporary).map_err(refused)?;
    file.write_all(bytes).map_err(refused)?;
    // Syncs bytes and length, but not the times of the file.
    file.sync_data().map_err(refused)?;
    drop(file);
    place(temporary, target)
}

/// Gives a synced file its name and creates the folder, unless the name exists. Returns whether it was given.
///
/// # Errors
/// If the system reports an error.
pub fn link(temporary: &Path, target: &Path) -> Result<bool, StoreError> {
    make_folder_of(target)?;
    match delayed_names::until_seen(|| fs::hard_link(temporary, target)) {
        Ok(()) => {
            // If this fails, the other name is removed with its folder.
            let _ = fs::remove_file(temporary);
        }
        Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(false),
        // The file system has no hard links.
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

/// Whether the file system does not support hard links (FAT, some FUSE file systems).
fn is_unknown(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::Unsupported | ErrorKind::PermissionDenied)
}

/// Moves a synced file into place and creates its folder.
///
/// # Errors
/// If the system reports an error.
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

/// Syncs a folder, so that a crash of the machine does not lose names in it.
///
/// # Errors
/// If the system reports an error.
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
