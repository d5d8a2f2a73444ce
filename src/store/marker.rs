//! The file that makes a folder a store and says which layout it has.

use std::io::ErrorKind;
use std::path::Path;

use super::atomic;
use super::error::StoreError;
use deaflow_base::read_own;

/// What it says.
const FORMAT: &str = "deaflow-store 2";

/// What the marker of any version begins with.
const TITLE: &str = "deaflow-store ";

const MAX_BYTES: u64 = 4096;

/// Whether the marker is that of a store that can be opened.
///
/// # Errors
/// When it is damaged, or that of another version, or the system refuses.
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
            Err(damaged(format!("it says {shown:?} in place of `{FORMAT}`")))
        }
    }
}

/// Writes the marker by way of a folder aside.
///
/// # Errors
/// When the system refuses.
pub fn write(aside: &Path, marker: &Path) -> Result<(), StoreError> {
    atomic::write(&aside.join("format"), marker, format!("{FORMAT}\n").as_bytes())
}
