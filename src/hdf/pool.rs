//! The child processes that read untrusted files. Each file has its own, so that a malicious file cannot access
//! another.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::error::{Failure, HdfError};
use super::message::{FileRequest, Request};
use super::session::{Received, Session};

/// The largest number of processes.
const MAX_PROCESSES: usize = 4;

/// The files that a process reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Key {
    /// One file.
    File(PathBuf),
    /// The files of stores with correct checksums, which are checked once before this process opens them.
    Stores,
}

type Shared = Arc<Mutex<Option<Session>>>;

/// The sessions, the most recently used at the end.
static POOL: Mutex<Vec<(Key, Shared)>> = Mutex::new(Vec::new());

/// Sends a request to the process with this key, and starts it if necessary.
///
/// # Errors
/// As for [`Session::request`], or if the process cannot be started.
pub(super) fn send(key: &Key, path: &Path, request: Request) -> Result<Received, HdfError> {
    let name = path.to_str().ok_or_else(|| {
        let why = "its name is not UTF-8, so HDF5 cannot open it";
        HdfError::failed(path, Failure::Refused(why.to_owned()))
    })?;
    let request = FileRequest {
        path: name.to_owned(),
        request,
    };
    let shared = session(key);
    // After a panic of another thread the state of the process is unknown.
    let mut session = shared.lock().unwrap_or_else(|poisoned| {
        let mut session = poisoned.into_inner();
        *session = None;
        session
    });
    let running = match session.as_mut() {
        Some(running) => running,
        None => session.insert(Session::start(path)?),
    };
    let received = running.request(path, &request);
    if !matches!(received, Ok(_) | Err(HdfError::Failed { .. })) {
        *session = None;
    }
    received
}

/// Lets a new process read the files of stores from the next request on. What a running one has read once, it may
/// return from its memory.
pub fn restart_store_reader() {
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    // Another thread may be waiting for a response of the old process, which ends after it.
    pool.retain(|(key, _)| *key != Key::Stores);
}

fn session(key: &Key) -> Shared {
    // The list is valid even if another thread panicked.
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let found = match pool.iter().position(|(known, _)| known == key) {
        Some(at) => pool.remove(at),
        None => (key.clone(), Shared::default()),
    };
    let shared = found.1.clone();
    pool.push(found);
    if pool.len() > MAX_PROCESSES {
        pool.remove(0);
    }
    shared
}
