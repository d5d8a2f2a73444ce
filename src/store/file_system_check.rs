//! Tests whether the file system supports what a store needs.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use super::error::StoreError;
use super::file_system::file_system;
use super::locking::LockingChoice;
use super::open::Store;
use super::stamp::{file_system_time, machine_time};

/// Clock difference above which a note is shown, s.
const SKEW: i64 = 2;

/// Free bytes and files below which a note is shown.
const LITTLE: (u64, u64) = (1 << 30, 10_000);

/// Length of the file to test the quota, bytes.
const ASKED: u64 = 64 << 20;

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CheckResult {
    /// The file system supports it.
    Good,
    /// Not supported, but the store works without it.
    Noted,
    /// Not supported, and the store needs it.
    Bad,
}

/// One check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileSystemCheck {
    /// The name of the check.
    pub name: &'static str,
    /// The result.
    pub result: CheckResult,
    /// The finding.
    pub found: String,
}

/// What was found of the file system of a store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileSystemReport {
    /// Its kind.
    pub file_system: String,
    /// The locking method, and the reason for it.
    pub choice: LockingChoice,
    /// The checks.
    pub checks: Vec<FileSystemCheck>,
}

impl Store {
    /// Tries what a store needs, in a folder of its own there.
    ///
    /// # Errors
    /// If the store is not writable.
    pub fn check_file_system(&self) -> Result<FileSystemReport, StoreError> {
        let folder = self.temporary()?;
        let folder = folder.path();
        let check = |name, tried: io::Result<(CheckResult, String)>| {
            let (result, found) = tried.unwrap_or_else(|error| (CheckResult::Bad, error.to_string()));
            FileSystemCheck { name, result, found }
        };
        Ok(FileSystemReport {
            file_system: file_system(self.root()).0,
            choice: self.locking().clone(),
            checks: vec![
                check("locks", locks(folder)),
                check("link", link(folder)),
                check("rename", rename(folder)),
                check("exclusive creation", exclusive(folder)),
                check("sync", sync(folder)),
                check("clock", clock(folder)),
                check("room", room(folder)),
            ],
        })
    }
}

fn locks(folder: &Path) -> io::Result<(CheckResult, String)> {
    let path = folder.join("lock");
    let (one, other) = (File::create(&path)?, File::open(&path)?);
    if let Err(error) = one.try_lock() {
        let error = io::Error::from(error);
        return Ok((CheckResult::Noted, format!("not supported: {error}; claims are used")));
    }
    Ok(match other.try_lock_shared() {
        Err(fs::TryLockError::WouldBlock) => (CheckResult::Good, "exclude other processes of this machine".to_owned()),
        _ => (CheckResult::Noted, "not exclusive; claims are used".to_owned()),
    })
}

fn link(folder: &Path) -> io::Result<(CheckResult, String)> {
    let (one, two) = (folder.join("one"), folder.join("two"));
    fs::write(&one, "1")?;
    match fs::hard_link(&one, &two) {
        Err(error) => {
            return Ok((CheckResult::Noted, format!("not supported: {error}; files are renamed")));
        }
        Ok(()) => fs::write(folder.join("three"), "3")?,
    }
    Ok(match fs::hard_link(folder.join("three"), &two) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            (CheckResult::Good, "does not replace existing files".to_owned())
        }
        Err(error) => return Err(error),
        Ok(()) => (CheckResult::Bad, "replaces existing files".to_owned()),
    })
}

fn rename(folder: &Path) -> io::Result<(CheckResult, String)> {
    let (one, two) = (folder.join("new"), folder.join("old"));
    fs::write(&one, "new")?;
    fs::write(&two, "old")?;
    fs::rename(&one, &two)?;
    Ok(match fs::read(&two)?.as_slice() {
        b"new" => (CheckResult::Good, "replaces atomically".to_owned()),
        _ => (CheckResult::Bad, "the renamed file is missing".to_owned()),
    })
}

fn exclusive(folder: &Path) -> io::Result<(CheckResult, String)> {
    let path = folder.join("claim");
    fs::create_dir(&path)?;
    Ok(match fs::create_dir(&path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            (CheckResult::Good, "only one process succeeds".to_owned())
        }
        Err(error) => return Err(error),
        Ok(()) => (CheckResult::Bad, "a folder can be created twice".to_owned()),
    })
}

fn sync(folder: &Path) -> io::Result<(CheckResult, String)> {
    let mut file = File::create(folder.join("synced"))?;
    file.write_all(b"1")?;
    file.sync_all()?;
    Ok(match File::open(folder).and_then(|folder| folder.sync_all()) {
        Ok(()) => (CheckResult::Good, "files and folders".to_owned()),
        Err(error) => (CheckResult::Bad, format!("folders cannot be synced: {error}")),
    })
}

fn clock(folder: &Path) -> io::Result<(CheckResult, String)> {
    let (before, there, after) = (machine_time(), file_system_time(folder), machine_time());
    let Some(there) = there else {
        return Ok((
            CheckResult::Noted,
            "the clock of the file system cannot be read".to_owned(),
        ));
    };
    let skew = match () {
        () if there.0 < before.0 - 1 => there.0 - before.0,
        () if there.0 > after.0 + 1 => there.0 - after.0,
        () => 0,
    };
    Ok(match skew.abs() > SKEW {
        false => (CheckResult::Good, "same as this machine".to_owned()),
        true => (
            CheckResult::Noted,
            format!("differs by {skew:+} s from this machine; ages use the clock of the file system"),
        ),
    })
}

fn room(folder: &Path) -> io::Result<(CheckResult, String)> {
    let found = rustix::fs::statvfs(folder)?;
    let bytes = found.f_bavail.saturating_mul(found.f_frsize);
    // Some file systems create inodes on demand and report 0.
    let files = (found.f_files > 0).then_some(found.f_favail);
    // The quota cannot be queried, but allocating a file tests it.
    let file = File::create(folder.join("room"))?;
    let refused = rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, ASKED);
    if refused == Err(rustix::io::Errno::DQUOT) {
        return Ok((
            CheckResult::Noted,
            format!("less than {} MiB left in the quota", ASKED >> 20),
        ));
    }
    let little = bytes < LITTLE.0 || files.is_some_and(|files| files < LITTLE.1);
    let result = if little { CheckResult::Noted } else { CheckResult::Good };
    let files = files.map_or_else(|| "unlimited files".to_owned(), |files| format!("{files} files"));
    Ok((
        result,
        format!("{:.1} GiB and {files} free", bytes as f64 / f64::from(1 << 30)),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_store_can_work_here() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let found = store.check_file_system().unwrap();
        assert_eq!(found.checks.len(), 7);
        assert!(
            found.checks.iter().all(|check| check.result != CheckResult::Bad),
            "{found:?}"
        );
        assert!(!found.file_system.is_empty() && !found.choice.reason.is_empty());
    }
}
