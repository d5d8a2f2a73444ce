//! The access of a process to an open store: its locks or claims, and its folder for temporary files.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::claims::Claims;
use super::entries::{files_in, is_folder, is_temporary, names_in, remove_file};
use super::error::StoreError;
use super::layout::Layout;
use super::lock::{self, Guard, is_read_only};
use super::locking::{self, LockingChoice, LockingMethod};
use super::presence::{ALONE, ExclusiveMark, HeartbeatTimes, OnFullDisk, Presence, ProcessState};
use super::stamp::Time;
use super::temporary_folder::{self, TemporaryFolder};
use deaflow_base::{ActionKey, read_own};

/// How long to wait for a process with exclusive access.
const PATIENCE: Duration = Duration::from_secs(600);

/// Pause before checking again.
const PAUSE: Duration = Duration::from_millis(100);

/// Age after which temporary files of unknown processes are removed, s by the clock of the file system: names may
/// appear late.
const ABANDONED: i64 = 900;

/// The access of a process to a store.
pub struct StoreSession {
    // The order of fields is the order of dropping: temporary files first, then locks.
    pub temporary_folder: TemporaryFolder,
    pub claims: Option<Claims>,
    _alone: Option<ExclusiveMark>,
    _run: Option<Guard>,
    pub choice: LockingChoice,
}

impl StoreSession {
    /// Opens a session with shared access, and removes what dead processes left.
    ///
    /// # Errors
    /// If another process has exclusive access for long, or the system reports an error.
    pub fn shared(layout: &Layout) -> Result<Self, StoreError> {
        let choice = locking::choose(layout);
        if choice.method == LockingMethod::Claims {
            let Some(presence) = announce(layout, OnFullDisk::Fail)? else {
                return Ok(Self::unseen(layout, choice));
            };
            wait_for_alone(layout, &presence)?;
            return Self::by_claims(layout, choice, presence, None);
        }
        if let Some(_alone) = lock::try_exclusive(&layout.run_lock())? {
            clear(&layout.temporary())?;
        }
        let start = Instant::now();
        let run = loop {
            match lock::try_shared(&layout.run_lock())? {
                Some(run) => break run,
                None if start.elapsed() > PATIENCE => return Err(busy(layout, holder(layout))),
                None => std::thread::sleep(PAUSE),
            }
        };
        Ok(Self::by_locks(layout, choice, run))
    }

    /// Opens a session with exclusive access, also on a full disk.
    ///
    /// # Errors
    /// If another process has the store open, or the system reports an error.
    pub fn alone(layout: &Layout) -> Result<Self, StoreError> {
        let choice = locking::choose(layout);
        if choice.method == LockingMethod::Claims {
            let Some(presence) = announce(layout, OnFullDisk::Continue)? else {
                return Ok(Self::unseen(layout, choice));
            };
            let alone = make_alone(layout, &presence)?;
            let others = living(layout, &presence)?;
            if !others.is_empty() {
                return Err(busy(layout, others));
            }
            return Self::by_claims(layout, choice, presence, Some(alone));
        }
        let run = lock::try_exclusive(&layout.run_lock())?.ok_or_else(|| busy(layout, holder(layout)))?;
        clear(&layout.temporary())?;
        Ok(Self::by_locks(layout, choice, run))
    }

    /// Opens a session for reading, without a lock.
    pub fn aside(layout: &Layout) -> Self {
        Self::unseen(layout, locking::choose(layout))
    }

    fn by_locks(layout: &Layout, choice: LockingChoice, run: Guard) -> Self {
        Self {
            _run: Some(run),
            ..Self::unseen(layout, choice)
        }
    }

    fn unseen(layout: &Layout, choice: LockingChoice) -> Self {
        Self {
            // Locks are used only on local file systems.
            temporary_folder: TemporaryFolder::new(&layout.temporary(), None, choice.method == LockingMethod::Locks),
            claims: None,
            _alone: None,
            _run: None,
            choice,
        }
    }

    fn by_claims(
        layout: &Layout,
        choice: LockingChoice,
        presence: Arc<Presence>,
        alone: Option<ExclusiveMark>,
    ) -> Result<Self, StoreError> {
        let claims = Claims::new(&layout.claims(), presence.clone())?;
        clear_of_dead(layout, &presence, &claims)?;
        Ok(Self {
            temporary_folder: TemporaryFolder::new(&layout.temporary(), Some(presence.name()), false),
            claims: Some(claims),
            _alone: alone,
            _run: None,
            choice,
        })
    }

    /// Releases all claims and the heartbeat of this process.
    pub fn leave(&self) {
        if let Some(claims) = &self.claims {
            claims.leave();
        }
    }

    /// Returns the name of this machine, if several share the store.
    pub fn host(&self) -> Option<&str> {
        self.claims.as_ref().map(|claims| claims.host())
    }

    /// Locks an action, unless another process has it.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn try_action(&self, layout: &Layout, key: &ActionKey) -> Result<Option<Guard>, StoreError> {
        self.try_named(&layout.action_lock(key), &key.to_string())
    }

    /// Locks a file or claims a name, depending on the locking method, unless another process has it.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn try_named(&self, file: &Path, name: &str) -> Result<Option<Guard>, StoreError> {
        match &self.claims {
            None => lock::try_exclusive(file),
            Some(claims) => Ok(claims.try_take(name)?.map(Guard::from)),
        }
    }

    /// Describes the process that runs an action, if known.
    pub fn action_owner(&self, layout: &Layout, key: &ActionKey) -> Option<String> {
        match &self.claims {
            None => lock::holder(&layout.action_lock(key)),
            Some(claims) => claims.owner(&key.to_string()).map(|owner| owner.text()),
        }
    }
}

fn holder(layout: &Layout) -> Option<String> {
    lock::holder(&layout.run_lock())
}

/// Returns the heartbeat times. For tests, `DEAFLOW_CLAIM_SECONDS` sets the time after which a silent process counts as
/// dead.
fn times() -> HeartbeatTimes {
    let seconds = std::env::var("DEAFLOW_CLAIM_SECONDS").ok();
    let seconds: Option<f64> = seconds.and_then(|seconds| seconds.parse().ok());
    match seconds.filter(|seconds| (0.1..=3600.0).contains(seconds)) {
        None => HeartbeatTimes::USUAL,
        Some(seconds) => HeartbeatTimes {
            interval: Duration::from_secs_f64(seconds / 12.0),
            expiry: Duration::from_secs_f64(seconds),
        },
    }
}

/// Starts the heartbeat of this process; `None` if the store is read-only.
fn announce(layout: &Layout, on_full: OnFullDisk) -> Result<Option<Arc<Presence>>, StoreError> {
    match Presence::announce(&layout.processes(), times(), on_full) {
        Err(StoreError::Io { source, .. }) if is_read_only(&source) => Ok(None),
        presence => Ok(Some(Arc::new(presence?))),
    }
}

/// Waits until no process has exclusive access.
fn wait_for_alone(layout: &Layout, presence: &Presence) -> Result<(), StoreError> {
    let start = Instant::now();
    while names_in(&layout.processes())?.iter().any(|name| name == ALONE) {
        let holder = process_alone(layout);
        match presence.process_state(&holder) {
            ProcessState::Dead(_) => remove_alone(layout)?,
            ProcessState::Alive(owner) if start.elapsed() > PATIENCE => {
                return Err(busy(layout, owner.map(|owner| owner.text())));
            }
            ProcessState::Alive(_) => std::thread::sleep(PAUSE),
        }
    }
    Ok(())
}

fn make_alone(layout: &Layout, presence: &Presence) -> Result<ExclusiveMark, StoreError> {
    loop {
        if let Some(alone) = ExclusiveMark::try_make(&layout.processes(), presence.name())? {
            return Ok(alone);
        }
        let holder = process_alone(layout);
        match presence.process_state(&holder) {
            ProcessState::Dead(_) => remove_alone(layout)?,
            // A process that was killed on a full disk has no name.
            ProcessState::Alive(None) if holder.is_empty() && is_old(ALONE, layout) => remove_alone(layout)?,
            ProcessState::Alive(owner) => return Err(busy(layout, owner.map(|owner| owner.text()))),
        }
    }
}

/// Returns the name of the process with exclusive access.
fn process_alone(layout: &Layout) -> String {
    let bytes = read_own(&layout.processes().join(ALONE), 64).unwrap_or_default();
    String::from_utf8_lossy(&bytes).into_owned()
}

fn remove_alone(layout: &Layout) -> Result<(), StoreError> {
    remove_file(&layout.processes().join(ALONE))
}

/// Describes the other processes that may be running, without those whose heartbeat is old by the clock of the file
/// system.
fn living(layout: &Layout, presence: &Presence) -> Result<Vec<String>, StoreError> {
    let mut found = Vec::new();
    for name in presence.others()? {
        match presence.process_state(&name) {
            ProcessState::Alive(owner) if !is_old(&name, layout) => {
                found.push(owner.map_or(name, |owner| owner.text()))
            }
            _ => {}
        }
    }
    Ok(found)
}

/// Whether a file of a process is old by the clock of the file system.
fn is_old(name: &str, layout: &Layout) -> bool {
    let folder = layout.processes();
    is_abandoned(&folder.join(name), super::stamp::file_system_time(&folder))
}

fn busy(layout: &Layout, who: impl IntoIterator<Item = String>) -> StoreError {
    let who: Vec<String> = who.into_iter().collect();
    StoreError::Busy {
        path: layout.root().to_owned(),
        who: match who.as_slice() {
            [] => "another process".to_owned(),
            who => who.join(", "),
        },
    }
}

/// Removes temporary files of dead processes, and old ones of unknown processes.
fn clear_of_dead(layout: &Layout, presence: &Presence, claims: &Claims) -> Result<(), StoreError> {
    // Lists the folders first: a process starts its heartbeat before it creates one.
    let folders = files_in(&layout.temporary())?;
    let now = super::stamp::file_system_time(&layout.processes());
    let others = presence.others()?;
    let is_dead = |name: &str| matches!(presence.process_state(name), ProcessState::Dead(_));
    for folder in folders.iter().filter(|folder| is_temporary(folder)) {
        let process = temporary_folder::process_of(folder).unwrap_or_default();
        let goes = match others.iter().any(|other| other == process) {
            true => is_dead(process),
            false => process != presence.name() && is_abandoned(folder, now),
        };
        if goes {
            remove(folder);
        }
    }
    let dead: Vec<&str> = others.iter().map(String::as_str).filter(|name| is_dead(name)).collect();
    claims.clear(&dead)?;
    dead.iter().for_each(|name| presence.remove_process(name));
    Ok(())
}

/// Whether a file is old by the clock of the file system.
fn is_abandoned(path: &Path, now: Option<Time>) -> bool {
    use std::os::unix::fs::MetadataExt;
    let written = fs::symlink_metadata(path).map(|metadata| metadata.mtime());
    match (written, now) {
        (Ok(written), Some((now, _))) => now.saturating_sub(written) > ABANDONED,
        _ => false,
    }
}

/// Removes temporary files when no other process is running. Files with other names are kept.
fn clear(folder: &Path) -> Result<(), StoreError> {
    let found = files_in(folder)?;
    found
        .iter()
        .filter(|path| is_temporary(path))
        .for_each(|path| remove(path));
    Ok(())
}

/// Removes a temporary file or folder. One that cannot be removed (a read-only store, a file that another machine has
/// open) stays for the next process.
fn remove(path: &Path) {
    let _ = match is_folder(path) {
        true => fs::remove_dir_all(path),
        false => fs::remove_file(path),
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Store;

    /// A store that has been opened by claims, so that all open it so.
    fn claimed(folder: &Path) -> Layout {
        drop(Store::open(folder).unwrap());
        let layout = Layout::of(folder).unwrap();
        fs::create_dir(layout.processes()).unwrap();
        layout
    }

    #[test]
    fn nobody_is_alone_while_another_is_there_and_nobody_comes_meanwhile() {
        let folder = tempfile::tempdir().unwrap();
        let layout = claimed(folder.path());
        let other = StoreSession::shared(&layout).unwrap();
        let refused = StoreSession::alone(&layout).err().unwrap().to_string();
        let own = format!("process {} on ", std::process::id());
        assert!(refused.contains(&own), "{refused}");
        drop(other);
        let alone = StoreSession::alone(&layout).unwrap();
        assert!(StoreSession::alone(&layout).is_err());
        std::thread::scope(|scope| {
            let waits = scope.spawn(|| StoreSession::shared(&layout).unwrap());
            std::thread::sleep(3 * PAUSE);
            assert!(!waits.is_finished());
            drop(alone);
            waits.join().unwrap();
        });
        assert_eq!(names_in(&layout.processes()).unwrap(), [""; 0]);
    }

    #[test]
    fn a_mark_of_nobody_ends_with_its_age() {
        let folder = tempfile::tempdir().unwrap();
        let layout = claimed(folder.path());
        let mark = layout.processes().join(ALONE);
        let file = fs::File::create(&mark).unwrap();
        assert!(StoreSession::alone(&layout).is_err(), "its name may not be written yet");
        let old = std::time::SystemTime::now() - Duration::from_secs(2 * ABANDONED as u64);
        file.set_modified(old).unwrap();
        drop(StoreSession::alone(&layout).unwrap());
        assert!(!mark.exists());
    }

    #[test]
    fn what_a_dead_process_left_goes_and_what_a_living_one_has_stays() {
        let folder = tempfile::tempdir().unwrap();
        let layout = claimed(folder.path());
        let key = ActionKey::of(b"key");
        let names = || {
            let mut names = [layout.temporary(), layout.claims(), layout.processes()].map(|f| names_in(&f).unwrap());
            names.iter_mut().for_each(|names| names.sort_unstable());
            names
        };
        let living = StoreSession::shared(&layout).unwrap();
        living.temporary_folder.file().unwrap();
        let _claim = living.try_action(&layout, &key).unwrap().unwrap();
        let before = names();
        // A process that was killed: its number is that of nobody, or its file says nothing any more.
        let gone = StoreSession::shared(&layout).unwrap();
        let name = gone.temporary_folder.folder().unwrap();
        let name = temporary_folder::process_of(&name).unwrap().to_owned();
        let _left = std::mem::ManuallyDrop::new(gone.temporary_folder.file().unwrap());
        std::mem::forget(gone.try_action(&layout, &ActionKey::of(b"other")).unwrap().unwrap());
        let sign = fs::read_to_string(layout.processes().join(&name)).unwrap();
        std::mem::forget(gone);
        assert_ne!(names(), before);
        let begun = sign.find("\"began\":").unwrap();
        let dead = format!("{}\"began\":1}},\"beats\":0}}", &sign[..begun]);
        fs::write(layout.processes().join(&name), dead).unwrap();
        fs::write(layout.temporary().join("notes"), "").unwrap();
        drop(StoreSession::shared(&layout).unwrap());
        fs::remove_file(layout.temporary().join("notes")).expect("only what is named as ours is removed");
        assert_eq!(names(), before);
    }
}
