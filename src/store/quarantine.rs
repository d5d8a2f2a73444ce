//! Moves damaged files to quarantine, where they can be examined.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rustix::fs::{Advice, fadvise};

use super::error::StoreError;
use super::layout::Layout;
use deaflow_base::open_regular;

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

/// Reads a file, and a second time if it is damaged, because a device, or the process that reads, may fail once. The
/// second reading does not depend on what the first one has left in memory. Only what is damaged both times may be
/// moved.
///
/// # Errors
/// As `read`; if the file is intact the second time, an error of the system.
pub fn read_twice<T>(path: &Path, read: impl Fn() -> Result<T, StoreError>) -> Result<T, StoreError> {
    match read() {
        Err(error) if !matches!(error, StoreError::Io { .. } | StoreError::Missing { .. }) => {
            forget_bytes(path);
            match read() {
                Ok(_) => Err(unsteady(path, &error)),
                again => again,
            }
        }
        found => found,
    }
}

/// Lets the next reading of a file take its bytes from the device: the system drops them from its memory, if nobody has
/// them mapped, and another process reads HDF5.
pub fn forget_bytes(path: &Path) {
    deaflow_hdf::restart_store_reader();
    if let Ok(file) = open_regular(path) {
        // Some file systems ignore it.
        let _ = fadvise(&file, 0, None, Advice::DontNeed);
    }
}

/// Returns the error for a file that was found damaged and is intact when it is read again.
pub fn unsteady(path: &Path, first: &StoreError) -> StoreError {
    let reason = match first {
        StoreError::Damaged { reason, .. } => reason.clone(),
        other => other.to_string(),
    };
    let text = format!("{reason}; read again, it is intact: check the disk and the memory of this machine");
    StoreError::io("read", path)(io::Error::other(text))
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    type Read = fn(&Path) -> Result<(), StoreError>;

    #[test]
    fn only_what_is_damaged_twice_is_damaged() {
        let path = Path::new("x.h5");
        let attempts = |first: Read, second: Read| {
            let count = Cell::new(0);
            let read = || {
                count.set(count.get() + 1);
                if count.get() == 1 { first(path) } else { second(path) }
            };
            (read_twice(path, read), count.get())
        };
        let bad: Read = |path| Err(StoreError::damaged(path, "its bytes have changed"));
        let failed: Read = |path| Err(StoreError::io("read", path)(io::Error::from_raw_os_error(5)));
        let good: Read = |_| Ok(());
        assert!(matches!(attempts(good, bad), (Ok(()), 1)));
        assert!(matches!(attempts(failed, good), (Err(StoreError::Io { .. }), 1)));
        assert!(matches!(attempts(bad, failed), (Err(StoreError::Io { .. }), 2)));
        assert!(matches!(attempts(bad, bad), (Err(StoreError::Damaged { .. }), 2)));
        let (unsteady, _) = attempts(bad, good);
        let told = unsteady.unwrap_err().to_string();
        assert!(
            told.contains("x.h5") && told.contains("its bytes have changed; read again"),
            "{told}"
        );
    }
}
