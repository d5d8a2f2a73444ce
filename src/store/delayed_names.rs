//! Names that are seen late: on a shared file system what another machine has made may be absent here for as long as
//! names are remembered.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use deaflow_base::temporary_file;

/// Maximum delay: 1.5 times that with which usual settings of network file systems cache missing names.
pub const LATEST: Duration = Duration::from_secs(90);

/// Pause before checking again.
pub const PAUSE: Duration = Duration::from_millis(50);

/// Whether a store is open on a file system with delayed names.
static EXPECTED: AtomicBool = AtomicBool::new(false);

/// From now on, missing names are checked again.
pub fn expect() {
    EXPECTED.store(true, Ordering::Relaxed);
}

/// Repeats an operation on a name that must exist, while the name is missing or stale.
///
/// # Errors
/// The last error of the system.
pub fn until_seen<T>(mut attempt: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    let start = Instant::now();
    loop {
        match attempt() {
            Err(error) if is_late(&error) && EXPECTED.load(Ordering::Relaxed) && start.elapsed() < LATEST => {
                std::thread::sleep(PAUSE);
            }
            done => return done,
        }
    }
}

/// As [`until_seen`] for a name that need not be there: it is waited for only where its folder lists it, which is
/// answered by the server.
///
/// # Errors
/// The last error of the system.
pub fn if_listed<T>(path: &Path, mut attempt: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    match attempt() {
        Err(error) if is_late(&error) && EXPECTED.load(Ordering::Relaxed) && is_listed(path) => until_seen(attempt),
        done => done,
    }
}

/// Has this machine forget what it remembers of a folder: a network file system does so where a name is made in it.
pub fn refresh(folder: &Path) {
    if EXPECTED.load(Ordering::Relaxed) {
        // Where nothing can be written, nothing is built either.
        let _ = temporary_file(folder);
    }
}

fn is_listed(path: &Path) -> bool {
    let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
        return false;
    };
    // The folder may be as new as what is in it.
    let entries = match fs::read_dir(folder) {
        Err(error) if is_late(&error) && is_listed(folder) => until_seen(|| fs::read_dir(folder)),
        entries => entries,
    };
    let entries = entries.into_iter().flatten();
    entries.flatten().any(|entry| entry.file_name() == name)
}

/// Whether a name is missing or stale.
pub fn is_late(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::NotFound | ErrorKind::StaleNetworkFileHandle)
}

/// Makes a folder and those above it. One that is there already is as good, whether it is seen yet or not.
///
/// # Errors
/// If the system reports an error.
pub fn make_folders(path: &Path) -> io::Result<()> {
    let make = || match fs::create_dir(path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(()),
        made => made,
    };
    match (make(), path.parent()) {
        (Err(error), Some(parent)) if error.kind() == ErrorKind::NotFound && !parent.as_os_str().is_empty() => {
            make_folders(parent)?;
            until_seen(make)
        }
        (made, _) => made,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_made_whether_they_are_there_or_not() {
        let folder = tempfile::tempdir().unwrap();
        let deep = folder.path().join("a/b/c");
        make_folders(&deep).unwrap();
        make_folders(&deep).unwrap();
        assert!(deep.is_dir());
        fs::write(folder.path().join("file"), "").unwrap();
        assert!(make_folders(&folder.path().join("file/below")).is_err());
    }
}
