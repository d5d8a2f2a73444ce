//! Moves damaged files to quarantine, where they can be examined.

use std::fs;
use std::path::{Path, PathBuf};

use super::error::StoreError;
use super::layout::Layout;

/// Moves a file to quarantine, and returns its new path; does nothing if there is none.
///
/// # Errors
/// If the system reports an error.
pub fn quarantine(layout: &Layout, path: &Path) -> Result<Option<PathBuf>, StoreError> {
    if fs::symlink_metadata(path).is_err() {
        return Ok(None);
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let aside = (0..u32::MAX)
        .map(|n| layout.quarantine().join(format!("{name}.{n}")))
        .find(|aside| fs::symlink_metadata(aside).is_err())
        .unwrap_or_else(|| layout.quarantine().join(&*name));
    fs::rename(path, &aside).map_err(StoreError::io("move to quarantine", path))?;
    Ok(Some(aside))
}
