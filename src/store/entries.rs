//! What lies in the folders of a store, ours and others'.
//!
//! File managers, editors and people leave files everywhere. What is not named as we name things is passed over, here and by
//! every command; `fsck` names it. We make no links: one that leads nowhere is nothing, one that leads elsewhere is not
//! followed.

use std::fs::{self, DirEntry};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::error::StoreError;
use deaflow_base::leads_nowhere_at;

/// What the names of files and folders being written begin with, as the crate `tempfile` names them.
pub const TEMPORARY: &str = ".tmp";

/// Letters and digits that follow, in the same crate and in the names of processes.
pub const LETTERS: usize = 6;

/// Everything in a folder, in order, but for links that lead nowhere.
///
/// # Errors
/// When the system refuses.
pub fn files_in(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut out = Vec::new();
    for entry in entries(folder)? {
        let path = entry.path();
        if !(is_link(&entry) && leads_nowhere_at(&path)) {
            out.push(path);
        }
    }
    out.sort_unstable();
    Ok(out)
}

/// Names of everything in a folder, in no order, but for links that lead nowhere and names that are no text.
///
/// # Errors
/// When the system refuses.
pub fn names_in(folder: &Path) -> Result<Vec<String>, StoreError> {
    let found = entries(folder)?.into_iter();
    let found = found.filter(|entry| !(is_link(entry) && leads_nowhere_at(&entry.path())));
    Ok(found.filter_map(|entry| entry.file_name().into_string().ok()).collect())
}

/// Everything in a folder that need not be there, in order. Only where there is nothing at all of its name there is nothing in
/// it: a folder that cannot be read, or something else in its place, may hide what was in it.
///
/// # Errors
/// When the system refuses.
pub fn files_in_optional(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    match fs::symlink_metadata(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        _ => files_in(folder),
    }
}

/// Everything two levels down, in order.
///
/// # Errors
/// When the system refuses.
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

/// Whether a path is a folder itself, and no link to one.
pub fn is_folder(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_dir())
}

/// Whether a path is a file itself, and no link to one.
pub fn is_file(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file())
}

/// Whether a name is one of those that file systems and their viewers leave everywhere.
pub fn is_hidden(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

/// Whether a file or folder in `tmp` was made there by a process that wrote it.
pub fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let is_named = name.strip_prefix(TEMPORARY).is_some_and(|rest| rest.len() == LETTERS);
    is_named && (is_file(path) || is_folder(path))
}

/// Whether an entry is a link.
pub fn is_link(entry: &DirEntry) -> bool {
    entry.file_type().is_ok_and(|kind| kind.is_symlink())
}

/// All entries of a folder.
///
/// # Errors
/// When the system refuses.
pub fn entries(folder: &Path) -> Result<Vec<DirEntry>, StoreError> {
    let read = fs::read_dir(folder).and_then(Iterator::collect);
    read.map_err(StoreError::io("read", folder))
}
