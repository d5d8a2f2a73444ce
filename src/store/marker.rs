//! The marker file, which identifies a store and the version of its layout.

use std::io::ErrorKind;
use std::path::Path;

use super::atomic;
use super::error::StoreError;
use deaflow_base::read_own;

/// Its content.
const FORMAT: &str = "deaflow-store 2";

/// The start of the marker of any version.
const TITLE: &str = "deaflow-store ";

const MAX_BYTES: u64 = 4096;

/// Checks the marker of a store.
///
/// # Errors
/// If it is damaged, or of another version, or the system reports an error.
pub fn check(marker: &Path) -> Result<(), StoreError> {
    let damaged = |reason: String| StoreError::Marker {
        path: marker.to_owned(),
        reason,
    };
    let bytes = read_own(marker, MAX_BYTES).map_err(|error| match error.kind() {
        ErrorKind::InvalidInput | ErrorKind::FileTooLarge => damaged(error.to_string()),
        _ => StoreError::io("read", marker)(error),
    })?;
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_end();
    let is_number = |rest: &str| !rest.is_empty() && rest.bytes().all(|byte| byte.is_ascii_digit());
    match text {
        FORMAT => Ok(()),
        other if other.strip_prefix(TITLE).is_some_and(is_number) => Err(StoreError::Format {
            path: marker.to_owned(),
            found: other.chars().take(80).collect(),
            known: FORMAT,
        }),
        other => {
            let shown: String = other.chars().take(80).collect();
            Err(damaged(format!("it contains {shown:?} instead of `{FORMAT}`")))
        }
    }
}

/// Writes the marker by way of a temporary folder.
///
/// # Errors
/// If the system reports an error.
pub fn write(aside: &Path, marker: &Path) -> Result<(), StoreError> {
    atomic::write(&aside.join("format"), marker, format!("{FORMAT}\n").as_bytes())
}
