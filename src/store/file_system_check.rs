//! What a file system does of what a store needs, tried and not looked up.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use super::error::StoreError;
use super::locking::{self, LockingChoice};
use super::open::Store;
use super::stamp::{file_system_time, machine_time};

/// Clocks that differ by more are worth a word, s.
const SKEW: i64 = 2;

/// Less room is worth a word: bytes, and files.
const LITTLE: (u64, u64) = (1 << 30, 10_000);

/// Length of a file that is asked for, bytes.
const ASKED: u64 = 64 << 20;

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CheckResult {
    /// As a store needs it.
    Good,
    /// A store does without.
    Noted,
    /// A store cannot do without.
    Bad,
}

/// One check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileSystemCheck {
    /// What was tried.
    pub name: &'static str,
    /// How it ended.
    pub result: CheckResult,
    /// What was found.
    pub found: String,
}

/// What was found of the file system of a store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileSystemReport {
    /// Its kind.
    pub file_system: String,
    /// How processes keep out of each other's way, and why.
    pub choice: LockingChoice,
    /// The checks.
    pub checks: Vec<FileSystemCheck>,
}

impl Store {
    /// Tries what a store needs, in a folder of its own there.
    ///
    /// # Errors
    /// When nothing can be written.
    pub fn check_file_system(&self) -> Result<FileSystemReport, StoreError> {
        let folder = self.temporary()?;
        let folder = folder.path();
        let check = |name, tried: io::Result<(CheckResult, String)>| {
            let (result, found) = tried.unwrap_or_else(|error| (CheckResult::Bad, error.to_string()));
            FileSystemCheck { name, result, found }
        };
        Ok(FileSystemReport {
            file_system: locking::file_system(self.root()).0,
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
        return Ok((CheckResult::Noted, format!("none: {error}; claims do without")));
    }
    Ok(match other.try_lock_shared() {
        Err(fs::TryLockError::WouldBlock) => (CheckResult::Good, "exclude others of this machine".to_owned()),
        _ => (CheckResult::Noted, "granted to everybody; claims do without".to_owned()),
    })
}

fn link(folder: &Path) -> io::Result<(CheckResult, String)> {
    let (one, two) = (folder.join("one"), folder.join("two"));
    fs::write(&one, "1")?;
    match fs::hard_link(&one, &two) {
        Err(error) => {
            return Ok((
                CheckResult::Noted,
                format!("none: {error}; files are renamed into place"),
            ));
        }
        Ok(()) => fs::write(folder.join("three"), "3")?,
    }
    Ok(match fs::hard_link(folder.join("three"), &two) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => (CheckResult::Good, "replaces nothing".to_owned()),
        Err(error) => return Err(error),
        Ok(()) => (CheckResult::Bad, "replaces what is there".to_owned()),
    })
}

fn rename(folder: &Path) -> io::Result<(CheckResult, String)> {
    let (one, two) = (folder.join("new"), folder.join("old"));
    fs::write(&one, "new")?;
    fs::write(&two, "old")?;
    fs::rename(&one, &two)?;
    Ok(match fs::read(&two)?.as_slice() {
        b"new" => (CheckResult::Good, "replaces in one step".to_owned()),
        _ => (CheckResult::Bad, "what was renamed is not there".to_owned()),
    })
}

fn exclusive(folder: &Path) -> io::Result<(CheckResult, String)> {
    let path = folder.join("claim");
    fs::create_dir(&path)?;
    Ok(match fs::create_dir(&path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => (CheckResult::Good, "one of all succeeds".to_owned()),
        Err(error) => return Err(error),
        Ok(()) => (CheckResult::Bad, "a folder can be made twice".to_owned()),
    })
}

fn sync(folder: &Path) -> io::Result<(CheckResult, String)> {
    let mut file = File::create(folder.join("synced"))?;
    file.write_all(b"1")?;
    file.sync_all()?;
    Ok(match File::open(folder).and_then(|folder| folder.sync_all()) {
        Ok(()) => (CheckResult::Good, "files and folders".to_owned()),
        Err(error) => (CheckResult::Bad, format!("files, and no folders: {error}")),
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
        false => (CheckResult::Good, "that of this machine".to_owned()),
        true => (
            CheckResult::Noted,
            format!("{skew:+} s to that of this machine; ages are judged by the file system's"),
        ),
    })
}

fn room(folder: &Path) -> io::Result<(CheckResult, String)> {
    let found = rustix::fs::statvfs(folder)?;
    let bytes = found.f_bavail.saturating_mul(found.f_frsize);
    // Some file systems make files as they are needed, and say 0.
    let files = (found.f_files > 0).then_some(found.f_favail);
    // What a quota leaves is not told; but a file can be asked for.
    let file = File::create(folder.join("room"))?;
    let refused = rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, ASKED);
    if refused == Err(rustix::io::Errno::DQUOT) {
        return Ok((
            CheckResult::Noted,
            format!("the quota leaves less than {} MiB", ASKED >> 20),
        ));
    }
    let little = bytes < LITTLE.0 || files.is_some_and(|files| files < LITTLE.1);
    let result = if little { CheckResult::Noted } else { CheckResult::Good };
    let files = files.map_or_else(|| "files as needed".to_owned(), |files| format!("{files} files"));
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
