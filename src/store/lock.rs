//! Locks between processes (and threads), by the standard library's file locks: they vanish with their process.
//!
//! A run holds the store's lock shared, so that whoever takes it exclusively (cleaning, collection) knows that nobody is
//! at work. An action's lock keeps two processes from building the same thing. Publishing an object is serialised, since
//! two files of equal content still differ in their provenance.

use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::path::Path;

use super::error::StoreError;
use crate::base::open_own;

/// A lock that is released when this is dropped.
#[derive(Debug)]
pub struct Guard {
    _file: File,
}

/// Waits for a shared lock.
///
/// # Errors
/// When the lock file cannot be opened or locked.
pub fn shared(path: &Path) -> Result<Guard, StoreError> {
    let file = open(path)?;
    file.lock_shared().map_err(StoreError::io("lock", path))?;
    Ok(Guard { _file: file })
}

/// Waits for an exclusive lock.
///
/// # Errors
/// When the lock file cannot be opened or locked.
pub fn exclusive(path: &Path) -> Result<Guard, StoreError> {
    let file = open(path)?;
    file.lock().map_err(StoreError::io("lock", path))?;
    Ok(Guard { _file: file })
}

/// Takes an exclusive lock unless another holds it.
///
/// # Errors
/// When the lock file cannot be opened or locked.
pub fn try_exclusive(path: &Path) -> Result<Option<Guard>, StoreError> {
    let file = open(path)?;
    match file.try_lock() {
        Ok(()) => Ok(Some(Guard { _file: file })),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(error)) => Err(StoreError::io("lock", path)(error)),
    }
}

/// Whether somebody holds the lock exclusively. The file is not made where there is none.
///
/// # Errors
/// When the lock file cannot be opened or locked.
pub fn is_held(path: &Path) -> Result<bool, StoreError> {
    let file = match open_own(path) {
        Ok(file) => file,
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::InvalidInput) => return Ok(false),
        Err(error) => return Err(StoreError::io("open", path)(error)),
    };
    // Shared, so that two who look do not see each other.
    match file.try_lock_shared() {
        Ok(()) => Ok(false),
        Err(TryLockError::WouldBlock) => Ok(true),
        Err(TryLockError::Error(error)) => Err(StoreError::io("lock", path)(error)),
    }
}

fn open(path: &Path) -> Result<File, StoreError> {
    let opened = File::options()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(path);
    match opened {
        // A store that may only be read can still be locked against collection.
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem
            ) =>
        {
            File::open(path).map_err(|_| StoreError::io("write", path)(error))
        }
        opened => opened.map_err(StoreError::io("open", path)),
    }
}
