//! File locks between processes and threads. They end with their process.
//!
//! A run holds the lock of the store shared; cleaning and garbage collection take it exclusively. The lock of an action
//! keeps two processes from building the same artifact.

use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use super::claims::Claim;
use super::error::StoreError;
use deaflow_base::open_own;

/// A lock or a claim, which ends when this is dropped.
pub struct Guard {
    _lock: LockOrClaim,
}

enum LockOrClaim {
    File { _file: File },
    Claim { _claim: Claim },
}

impl From<Claim> for Guard {
    fn from(claim: Claim) -> Self {
        Self {
            _lock: LockOrClaim::Claim { _claim: claim },
        }
    }
}

/// Takes a shared lock unless another process holds an exclusive one.
///
/// # Errors
/// If the lock file cannot be opened or locked.
pub fn try_shared(path: &Path) -> Result<Option<Guard>, StoreError> {
    attempt(path, open(path)?, File::try_lock_shared)
}

/// Takes an exclusive lock unless another process holds it.
///
/// # Errors
/// If the lock file cannot be opened or locked.
pub fn try_exclusive(path: &Path) -> Result<Option<Guard>, StoreError> {
    attempt(path, open(path)?, File::try_lock)
}

fn attempt(path: &Path, file: File, lock: fn(&File) -> Result<(), TryLockError>) -> Result<Option<Guard>, StoreError> {
    match lock(&file) {
        Ok(()) => Ok(Some(Guard {
            _lock: LockOrClaim::File { _file: file },
        })),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(error)) => Err(StoreError::io("lock", path)(error)),
    }
}

/// Whether a process holds the lock exclusively. Does not create the file.
///
/// # Errors
/// If the lock file cannot be opened or locked.
pub fn is_held(path: &Path) -> Result<bool, StoreError> {
    let file = match open_own(path) {
        Ok(file) => file,
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::InvalidInput) => return Ok(false),
        Err(error) => return Err(StoreError::io("open", path)(error)),
    };
    // Shared, so that two checks at the same time do not see each other.
    Ok(attempt(path, file, File::try_lock_shared)?.is_none())
}

/// Describes the other process of this machine that holds a lock, if the system reports one.
pub fn holder(path: &Path) -> Option<String> {
    let metadata = fs::metadata(path).ok()?;
    let (device, inode) = (metadata.dev(), metadata.ino());
    let file = format!(
        "{:02x}:{:02x}:{inode}",
        rustix::fs::major(device),
        rustix::fs::minor(device)
    );
    let locks = fs::read_to_string("/proc/locks").ok()?;
    // `1: FLOCK  ADVISORY  WRITE 4321 fe:00:123456 0 EOF`
    let process = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let at = words.iter().position(|word| *word == file)?;
        words.get(at.checked_sub(1)?)?.parse().ok()
    };
    let mut processes = locks.lines().filter_map(process);
    let pid: u32 = processes.find(|pid| *pid > 0 && *pid != std::process::id())?;
    let command = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let word = command.split(|byte| *byte == 0).nth(1).unwrap_or_default();
    Some(format!("process {pid} (`deaflow {}`)", String::from_utf8_lossy(word)))
}

fn open(path: &Path) -> Result<File, StoreError> {
    let opened = File::options()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(path);
    match opened {
        // A read-only store can still be locked against garbage collection.
        Err(error) if is_read_only(&error) => File::open(path).map_err(|_| StoreError::io("write", path)(error)),
        opened => opened.map_err(StoreError::io("open", path)),
    }
}

/// Whether a file may only be read.
pub fn is_read_only(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_holds_a_lock_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        fs::write(&path, "").unwrap();
        assert_eq!(holder(&path), None);
        let mut other = std::process::Command::new("flock")
            .arg(&path)
            .args(["sleep", "60"])
            .spawn()
            .unwrap();
        // The attempts of this process do not meet the other one, which waits for the lock.
        let start = std::time::Instant::now();
        let mut told = holder(&path);
        while told.is_none() && start.elapsed().as_secs() < 30 {
            std::thread::sleep(std::time::Duration::from_millis(10));
            told = holder(&path);
        }
        assert!(try_exclusive(&path).unwrap().is_none());
        other.kill().unwrap();
        other.wait().unwrap();
        assert!(told.unwrap().starts_with(&format!("process {} (", other.id())));
    }
}
