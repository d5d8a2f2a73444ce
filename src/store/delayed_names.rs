//! Names that are seen late: on a shared file system what another machine has made may be absent here for as long as names are remembered.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use deaflow_base::aside;

/// As long as the usual settings of network file systems remember that a name is absent, and half as long again.
pub const LATEST: Duration = Duration::from_secs(90);

/// Between two looks.
pub const PAUSE: Duration = Duration::from_millis(50);

/// Whether a store has been opened where names may be seen late. On a disk an absent name is absent.
static EXPECTED: AtomicBool = AtomicBool::new(false);

/// From now on absent names are looked at again.
pub fn expect() {
    EXPECTED.store(true, Ordering::Relaxed);
}

/// Does what needs a name that must be there, again while that is absent or stale.
///
/// # Errors
/// What the system says in the end.
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

/// As [`until_seen`] for a name that need not be there: it is waited for only where its folder lists it, which is answered by the server.
///
/// # Errors
/// What the system says in the end.
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
        let _ = aside(folder);
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

/// Whether a name is absent, or means what is no more.
pub fn is_late(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::NotFound | ErrorKind::StaleNetworkFileHandle)
}

/// Makes a folder and those above it. One that is there already is as good, whether it is seen yet or not.
///
/// # Errors
/// When the system refuses.
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
