//! The processes that read files of others: one for each file, and a few at a time, so that a file which has got the
//! better of its process has got nothing of another file.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::error::{Failure, HdfError};
use super::message::{Question, Request};
use super::session::{Session, Told};

/// Processes at a time.
const MOST: usize = 4;

/// What a process is for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Key {
    /// One file.
    File(PathBuf),
    /// The files of stores, whose checksums fit: they are looked at once, before this process opens them itself.
    Stores,
}

type Shared = Arc<Mutex<Option<Session>>>;

/// The sessions, that used last at the end.
static POOL: Mutex<Vec<(Key, Shared)>> = Mutex::new(Vec::new());

/// Asks the process of that key, which is started where it is not there.
///
/// # Errors
/// As [`Session::ask`], or when none can be started.
pub(super) fn ask(key: &Key, path: &Path, request: Request) -> Result<Told, HdfError> {
    let name = path.to_str().ok_or_else(|| {
        let why = "its name is not UTF-8, and HDF5 cannot open it";
        HdfError::failed(path, Failure::Refused(why.to_owned()))
    })?;
    let question = Question {
        path: name.to_owned(),
        request,
    };
    let shared = session(key);
    // A panic elsewhere while it was held leaves a process with which no more is to be said.
    let mut session = shared.lock().unwrap_or_else(|poisoned| {
        let mut session = poisoned.into_inner();
        *session = None;
        session
    });
    let running = match session.as_mut() {
        Some(running) => running,
        None => session.insert(Session::start(path)?),
    };
    let told = running.ask(path, &question);
    if !matches!(told, Ok(_) | Err(HdfError::Failed { .. })) {
        *session = None;
    }
    told
}

fn session(key: &Key) -> Shared {
    // Entries are moved one by one: a panic elsewhere leaves a list that is right.
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let found = match pool.iter().position(|(known, _)| known == key) {
        Some(at) => pool.remove(at),
        None => (key.clone(), Shared::default()),
    };
    let shared = found.1.clone();
    pool.push(found);
    if pool.len() > MOST {
        pool.remove(0);
    }
    shared
}
