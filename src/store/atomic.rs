//! Files appear whole or not at all: written aside, synced, renamed into place, and their folder synced.
//!
//! The order is that of the usual crash-consistency argument (Pillai et al., OSDI 2014): without the first sync a name
//! may point to missing bytes after a crash, without the second the name itself may be lost.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

use super::error::StoreError;

/// Writes `bytes` as `target`, by way of the file `temporary` in the same filesystem.
///
/// # Errors
/// When the system refuses; nothing is visible as `target` then.
pub fn write(temporary: &Path, target: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    write_unsettled(temporary, target, bytes)?;
    sync_folder(target.parent().unwrap_or(Path::new(".")))
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

/// Moves a synced file into place, creating its folder.
///
/// # Errors
/// When the system refuses.
pub fn rename(temporary: &Path, target: &Path) -> Result<(), StoreError> {
    place(temporary, target)?;
    sync_folder(target.parent().unwrap_or(Path::new(".")))
}

fn place(temporary: &Path, target: &Path) -> Result<(), StoreError> {
    let folder = target.parent().unwrap_or(Path::new("."));
    if !folder.is_dir() {
        fs::create_dir_all(folder).map_err(StoreError::io("create", folder))?;
        sync_folder(folder.parent().unwrap_or(Path::new(".")))?;
    }
    fs::rename(temporary, target).map_err(StoreError::io("write", target))
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
