//! Lists the folders of a store.
//!
//! Other programs may leave files there. Files with other names than those of the store are ignored by all commands and
//! reported by `fsck`. The store contains no links: broken ones are ignored and others are not followed.

use std::fs::{self, DirEntry};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::error::StoreError;
use deaflow_base::is_dangling_link;

/// Prefix of temporary files and folders, as in the crate `tempfile`.
pub const TEMPORARY: &str = ".tmp";

/// Number of letters and digits that follow; also the length of names of processes.
pub const LETTERS: usize = 6;

/// Returns the entries of a folder, sorted, without broken links.
///
/// # Errors
/// If the system reports an error.
pub fn files_in(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut out = Vec::new();
    for entry in entries(folder)? {
        let path = entry.path();
        if !(is_link(&entry) && is_dangling_link(&path)) {
            out.push(path);
        }
    }
    out.sort_unstable();
    Ok(out)
}

/// Returns the names in a folder, unsorted, without broken links and names that are not UTF-8.
///
/// # Errors
/// If the system reports an error.
pub fn names_in(folder: &Path) -> Result<Vec<String>, StoreError> {
    let found = entries(folder)?.into_iter();
    let found = found.filter(|entry| !(is_link(entry) && is_dangling_link(&entry.path())));
    Ok(found.filter_map(|entry| entry.file_name().into_string().ok()).collect())
}

/// Returns the entries of a folder that may be missing, sorted. A folder that cannot be read is an error.
///
/// # Errors
/// If the system reports an error.
pub fn files_in_optional(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    match fs::symlink_metadata(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        _ => files_in(folder),
    }
}

/// Returns the entries of the subfolders of a folder, sorted.
///
/// # Errors
/// If the system reports an error.
pub fn files(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut out = Vec::new();
    for path in files_in(folder)? {
        if is_folder(&path) {
            out.extend(files_in(&path)?);
        } else {
            out.push(path);
        }
    }
    Ok(out)
}

/// Whether a path is a folder and not a link.
pub fn is_folder(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_dir())
}

/// Whether a path is a regular file and not a link.
pub fn is_file(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file())
}

/// Whether a name starts with a dot, as those that file systems and file managers create.
pub fn is_hidden(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

/// Whether a path in `tmp` has the name of a temporary file or folder of a process.
pub fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let is_named = name.strip_prefix(TEMPORARY).is_some_and(|rest| rest.len() == LETTERS);
    is_named && (is_file(path) || is_folder(path))
}

/// Whether an entry is a link.
pub fn is_link(entry: &DirEntry) -> bool {
    entry.file_type().is_ok_and(|kind| kind.is_symlink())
}

/// Removes a file; does nothing if it does not exist.
///
/// # Errors
/// If the system reports an error.
pub fn remove_file(path: &Path) -> Result<(), StoreError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(StoreError::io("remove", path)(error)),
        _ => Ok(()),
    }
}

/// Returns all entries of a folder.
///
/// # Errors
/// If the system reports an error.
pub fn entries(folder: &Path) -> Result<Vec<DirEntry>, StoreError> {
    let read = fs::read_dir(folder).and_then(Iterator::collect);
    read.map_err(StoreError::io("read", folder))
}
