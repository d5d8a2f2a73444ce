//! The processes that have a store open, for file systems whose locks are not visible on other machines.
//!
//! Each process has a file in `locks/processes`, named by six letters or digits that no other has, and rewrites it
//! every few seconds. Whoever looks at it sees it change, whatever the clocks of the machines say; one that has not
//! changed for long by the clock of the one who looks is dead. A process of the same machine that has ended is known to
//! be dead at once.
//!
//! Who needs the store alone makes the file `alone` there. Both make their own file first and then list the folder: of
//! two who come at once at least one sees the other. To list a folder after writing in it is what network file systems
//! answer from the server, where the name alone may be answered from memory.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::delayed_names;
use super::entries::{LETTERS, names_in};
use super::error::StoreError;
use super::owner::Owner;
use deaflow_base::{Background, Pauses, read_own};

/// The file of the process with exclusive access.
pub const ALONE: &str = "alone";

/// Length of the file of a process, bytes, padded with spaces.
const HEARTBEAT_BYTES: usize = 1024;

/// Maximum length of the file of a process, bytes.
const LONGEST: u64 = 64 << 10;

/// Interval and expiry of heartbeats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeartbeatTimes {
    /// Time between two heartbeats.
    pub interval: Duration,
    /// Time without a heartbeat after which a process counts as dead.
    pub expiry: Duration,
}

impl HeartbeatTimes {
    /// The usual times: network file systems cache names for at most a minute with usual settings.
    pub const USUAL: Self = Self {
        interval: Duration::from_secs(5),
        expiry: Duration::from_secs(60),
    };
}

/// What a process does if the disk is too full for its own files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnFullDisk {
    /// It ends with an error.
    Fail,
    /// It continues, and writes them as soon as there is space: it is about to free some.
    Continue,
}

/// Pause before writing again to a full disk.
const FULL_PAUSE: Duration = Duration::from_millis(200);

/// The content of the file of a process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heartbeat {
    /// The process.
    pub owner: Owner,
    /// Number of heartbeats so far.
    pub beats: u64,
}

/// The heartbeat file of this process, removed on drop.
pub struct Presence {
    folder: PathBuf,
    owner: Owner,
    name: String,
    times: HeartbeatTimes,
    beats: Option<Background>,
    /// The last content of the files of others, and since when it has not changed.
    seen: Mutex<BTreeMap<String, (Vec<u8>, Instant)>>,
}

/// The state of a process.
#[derive(Clone, Debug, PartialEq)]
pub enum ProcessState {
    /// It may be running.
    Alive(Option<Owner>),
    /// It has ended, or its heartbeat has expired.
    Dead(Option<Owner>),
}

impl Presence {
    /// Starts the heartbeat of this process in a folder, which is created if missing.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn announce(folder: &Path, times: HeartbeatTimes, on_full: OnFullDisk) -> Result<Self, StoreError> {
        delayed_names::make_folders(folder).map_err(StoreError::io("create", folder))?;
        let owner = Owner::this();
        let heartbeat = Heartbeat {
            owner: owner.clone(),
            beats: 0,
        };
        // Names use randomness of the system, not the random streams of a pipeline.
        let named = || {
            tempfile::Builder::new()
                .prefix("")
                .rand_bytes(LETTERS)
                .tempfile_in(folder)
        };
        let file = delayed_names::until_seen(named).map_err(StoreError::io("write in", folder))?;
        let (_, path) = file
            .keep()
            .map_err(|error| StoreError::io("write", folder)(error.error))?;
        let mut is_shown = true;
        if let Err(error) = show(&path, &heartbeat) {
            if on_full == OnFullDisk::Fail || !is_full(&error) {
                let _ = fs::remove_file(&path);
                return Err(StoreError::io("write", &path)(error));
            }
            is_shown = false;
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let beat = move |pauses: &Pauses| {
            let mut heartbeat = heartbeat;
            // An empty file excludes others too, for as long as a heartbeat.
            while pauses.wait(if is_shown { times.interval } else { FULL_PAUSE }) {
                heartbeat.beats += 1;
                // An error is ignored: others wait for several heartbeats.
                is_shown |= show(&path, &heartbeat).is_ok();
            }
        };
        let beats = Background::start("presence", beat).map_err(StoreError::io("start a thread for", folder))?;
        Ok(Self {
            folder: folder.to_owned(),
            owner,
            name,
            times,
            beats: Some(beats),
            seen: Mutex::default(),
        })
    }

    /// Returns this process.
    pub fn owner(&self) -> &Owner {
        &self.owner
    }

    /// Returns the name of this process in the store.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the names of the other processes.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn others(&self) -> Result<Vec<String>, StoreError> {
        let names = names_in(&self.folder)?.into_iter();
        Ok(names.filter(|name| is_name(name) && *name != self.name).collect())
    }

    /// Returns the state of a process. Its heartbeat is watched from the first call on.
    pub fn process_state(&self, name: &str) -> ProcessState {
        let content = read_own(&self.folder.join(name), LONGEST).unwrap_or_default();
        self.state_of(name, content)
    }

    /// As [`Presence::process_state`], for content that has been read already.
    pub fn state_of(&self, name: &str, content: Vec<u8>) -> ProcessState {
        let owner = serde_json::from_slice::<Heartbeat>(&content)
            .ok()
            .map(|heartbeat| heartbeat.owner);
        if owner.as_ref().is_some_and(Owner::is_gone) {
            return ProcessState::Dead(owner);
        }
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        let entry = seen.entry(name.to_owned()).or_insert_with(|| (content.clone(), now));
        if entry.0 != content {
            *entry = (content, now);
        }
        match entry.1.elapsed() >= self.times.expiry {
            true => ProcessState::Dead(owner),
            false => ProcessState::Alive(owner),
        }
    }

    /// Removes the file of a dead process.
    pub fn remove_process(&self, name: &str) {
        // Another process may have removed it; a remaining file does no harm.
        let _ = fs::remove_file(self.folder.join(name));
    }
}

impl Drop for Presence {
    fn drop(&mut self) {
        drop(self.beats.take());
        let _ = fs::remove_file(self.folder.join(&self.name));
    }
}

/// Whether a file name is that of a process.
pub fn is_name(name: &str) -> bool {
    name.len() == LETTERS && name.bytes().all(|byte| byte.is_ascii_alphanumeric())
}

/// Overwrites the last heartbeat, which has the same length, so that readers never see a part of one.
fn show(path: &Path, heartbeat: &Heartbeat) -> std::io::Result<()> {
    let text = serde_json::to_string(heartbeat)?;
    let file = File::options().write(true).create(true).truncate(false).open(path)?;
    file.write_all_at(format!("{text:<HEARTBEAT_BYTES$}").as_bytes(), 0)
}

/// Whether an error says that there is no space left.
fn is_full(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
}

/// The file of a process with exclusive access, removed on drop.
pub struct ExclusiveMark {
    path: PathBuf,
    /// Writes the name of the process into it, if the disk was full.
    writes: Option<Background>,
}

impl ExclusiveMark {
    /// Creates the file; returns `None` if another process has. On a full disk it is empty until there is space, and
    /// others count it as that of a living process for as long as a heartbeat.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn try_make(folder: &Path, process: &str) -> Result<Option<Self>, StoreError> {
        let path = folder.join(ALONE);
        match File::options().write(true).create_new(true).open(&path) {
            Ok(mut file) => {
                let mut made = Self {
                    path: path.clone(),
                    writes: None,
                };
                match file.write_all(process.as_bytes()) {
                    Err(error) if is_full(&error) => {
                        let name = process.to_owned();
                        let write = move |pauses: &Pauses| {
                            while pauses.wait(FULL_PAUSE) && file.write_all_at(name.as_bytes(), 0).is_err() {}
                        };
                        let writes = Background::start("exclusive mark", write);
                        made.writes = Some(writes.map_err(StoreError::io("start a thread for", &path))?);
                    }
                    written => written.map_err(StoreError::io("write", &path))?,
                }
                Ok(Some(made))
            }
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(None),
            Err(error) => Err(StoreError::io("write", &path)(error)),
        }
    }
}

impl Drop for ExclusiveMark {
    fn drop(&mut self) {
        drop(self.writes.take());
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUICK: HeartbeatTimes = HeartbeatTimes {
        interval: Duration::from_millis(20),
        expiry: Duration::from_millis(400),
    };

    /// A process of another machine, which nobody can ask whether it lives.
    fn foreign(beats: u64) -> Vec<u8> {
        let mut heartbeat = serde_json::to_value(Heartbeat {
            owner: Owner::this(),
            beats,
        })
        .unwrap();
        heartbeat["owner"]["machine"] = "another".into();
        heartbeat["owner"]["host"] = "elsewhere".into();
        serde_json::to_vec(&heartbeat).unwrap()
    }

    #[test]
    fn a_process_shows_itself_until_it_ends() {
        let folder = tempfile::tempdir().unwrap();
        let one = Presence::announce(folder.path(), QUICK, OnFullDisk::Fail).unwrap();
        let two = Presence::announce(folder.path(), QUICK, OnFullDisk::Fail).unwrap();
        assert_eq!(one.others().unwrap(), [two.name()]);
        let path = folder.path().join(two.name());
        let before = fs::read(&path).unwrap();
        let until = Instant::now() + 2 * QUICK.expiry;
        while Instant::now() < until {
            assert!(matches!(one.process_state(two.name()), ProcessState::Alive(Some(_))));
            std::thread::sleep(QUICK.interval);
        }
        assert_ne!(fs::read(&path).unwrap(), before);
        drop(two);
        assert!(one.others().unwrap().is_empty());
    }

    #[test]
    fn one_that_shows_nothing_is_dead_after_a_while_and_not_before() {
        let folder = tempfile::tempdir().unwrap();
        let own = Presence::announce(folder.path(), QUICK, OnFullDisk::Fail).unwrap();
        fs::write(folder.path().join("abc123"), foreign(1)).unwrap();
        let start = Instant::now();
        while let ProcessState::Alive(owner) = own.process_state("abc123") {
            assert_eq!(owner.unwrap().host, "elsewhere");
            std::thread::sleep(QUICK.interval);
        }
        assert!(start.elapsed() >= QUICK.expiry);
        // It was only slow.
        fs::write(folder.path().join("abc123"), foreign(2)).unwrap();
        assert!(matches!(own.process_state("abc123"), ProcessState::Alive(_)));
        assert!(
            matches!(own.process_state("nobody"), ProcessState::Alive(None)),
            "its name may not be seen yet"
        );
    }

    #[test]
    fn of_two_one_is_alone() {
        let folder = tempfile::tempdir().unwrap();
        let first = ExclusiveMark::try_make(folder.path(), "abc123").unwrap();
        assert!(first.is_some() && ExclusiveMark::try_make(folder.path(), "def456").unwrap().is_none());
        drop(first);
        assert!(ExclusiveMark::try_make(folder.path(), "def456").unwrap().is_some());
    }
}
