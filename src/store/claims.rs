//! Claims on pieces of work, for file systems whose locks are not visible on other machines.
//!
//! A claim is a folder `locks/claims/<key>` with a file `owner` that names a process ([`Presence`]). On every file
//! system only one process succeeds in creating a folder. A claim lasts until its process removes it or dies.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use super::delayed_names;
use super::entries::names_in;
use super::error::StoreError;
use super::owner::Owner;
use super::presence::{Presence, ProcessState};
use super::stamp::Stamp;
use deaflow_base::read_own;

const OWNER: &str = "owner";

/// Maximum length of the name of a process, bytes.
const LONGEST: u64 = 64;

/// Pause before checking again for a folder that is not visible yet.
const PAUSE: Duration = Duration::from_millis(50);

/// Maximum number of attempts to claim.
const ATTEMPTS: usize = 2000;

/// The claims of a store.
#[derive(Clone)]
pub struct Claims {
    folder: PathBuf,
    presence: Arc<Presence>,
}

/// A claim of this process, released on drop.
pub struct Claim {
    folder: PathBuf,
    /// Name of this process.
    process: String,
}

impl Claims {
    /// Opens the claims in a folder, which is created if missing.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn new(folder: &Path, presence: Arc<Presence>) -> Result<Self, StoreError> {
        delayed_names::make_folders(folder).map_err(StoreError::io("create", folder))?;
        Ok(Self {
            folder: folder.to_owned(),
            presence,
        })
    }

    /// Returns the name of this machine.
    pub fn host(&self) -> &str {
        &self.presence.owner().host
    }

    /// Returns the name of this process in the store.
    pub fn process(&self) -> &str {
        self.presence.name()
    }

    /// Releases all claims of this process and removes its heartbeat file. Errors are ignored: claims expire.
    pub fn leave(&self) {
        let _ = self.clear(&[self.presence.name()]);
        self.presence.remove_process(self.presence.name());
    }

    /// Returns the process that has claimed a piece of work, if known.
    pub fn owner(&self, key: &str) -> Option<Owner> {
        let process = process_of(&self.folder.join(key));
        match process.as_str() {
            "" => None,
            own if own == self.presence.name() => Some(self.presence.owner().clone()),
            process => match self.presence.process_state(process) {
                ProcessState::Alive(owner) => owner,
                ProcessState::Dead(_) => None,
            },
        }
    }

    /// Claims a piece of work unless a living process or another thread has it.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn try_take(&self, key: &str) -> Result<Option<Claim>, StoreError> {
        let path = self.folder.join(key);
        for _ in 0..ATTEMPTS {
            match fs::create_dir(&path) {
                Ok(()) => {
                    let claim = Claim {
                        folder: path.clone(),
                        process: self.presence.name().to_owned(),
                    };
                    let owner = path.join(OWNER);
                    match fs::write(&owner, &claim.process) {
                        Ok(()) => return Ok(Some(claim)),
                        // Another process has removed the claim, because it had no owner for long.
                        Err(error) if delayed_names::is_late(&error) => std::thread::sleep(PAUSE),
                        Err(error) => {
                            // The disk is full. Without an owner, others would wait for the claim.
                            let _ = remove(&path);
                            return Err(StoreError::io("write", &owner)(error));
                        }
                    }
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                    let process = process_of(&path);
                    if process == self.presence.name() {
                        return Ok(None);
                    }
                    let life = match process.as_str() {
                        // Its process may be about to write its name, so the age of this claim is watched.
                        "" => self.presence.state_of(key, made(&path)),
                        process => self.presence.process_state(process),
                    };
                    match life {
                        ProcessState::Alive(_) => return Ok(None),
                        ProcessState::Dead(_) => self.evict(&path, &process)?,
                    }
                }
                // The folder has been removed, or its name is stale.
                Err(error) if delayed_names::is_late(&error) => {
                    delayed_names::make_folders(&self.folder).map_err(StoreError::io("create", &self.folder))?;
                    std::thread::sleep(PAUSE);
                }
                Err(error) => return Err(StoreError::io("claim", &path)(error)),
            }
        }
        Ok(None)
    }

    /// Removes the claims of dead processes.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn clear(&self, dead: &[&str]) -> Result<(), StoreError> {
        if dead.is_empty() {
            return Ok(());
        }
        for name in names_in(&self.folder)? {
            let path = self.folder.join(name);
            let process = process_of(&path);
            if dead.contains(&process.as_str()) {
                self.evict(&path, &process)?;
            }
        }
        Ok(())
    }

    /// Removes the claim of a dead process. It is renamed first: only one of several processes succeeds, and a late one
    /// does not remove the next claim.
    fn evict(&self, path: &Path, process: &str) -> Result<(), StoreError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let aside = self.folder.join(format!("{name}.{}", self.presence.name()));
        match fs::rename(path, &aside) {
            Ok(()) if process_of(&aside) == process => remove(&aside),
            Ok(()) => {
                // It was claimed again meanwhile. If it cannot be restored, the work may be done twice, with the same
                // result.
                let _ = fs::rename(&aside, path);
                Ok(())
            }
            Err(error) if delayed_names::is_late(&error) => Ok(()),
            Err(error) => Err(StoreError::io("remove", path)(error)),
        }
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // Another process may have considered this one dead and have claimed it. A claim that cannot be removed
        // expires.
        if process_of(&self.folder) == self.process {
            let _ = remove(&self.folder);
        }
    }
}

/// Identifies a claim among several claims on the same piece of work.
fn made(claim: &Path) -> Vec<u8> {
    let metadata = fs::symlink_metadata(claim);
    metadata.map_or_else(|_| Vec::new(), |found| format!("{:?}", Stamp::of(&found)).into_bytes())
}

fn process_of(claim: &Path) -> String {
    let bytes = read_own(&claim.join(OWNER), LONGEST).unwrap_or_default();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Removes a claim: first its owner, then the folder.
fn remove(claim: &Path) -> Result<(), StoreError> {
    let gone = |result: std::io::Result<()>, path: &Path| match result {
        Err(error) if !delayed_names::is_late(&error) => Err(StoreError::io("remove", path)(error)),
        _ => Ok(()),
    };
    let owner = claim.join(OWNER);
    gone(fs::remove_file(&owner), &owner)?;
    gone(fs::remove_dir(claim), claim)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::presence::{HeartbeatTimes, OnFullDisk};

    const QUICK: HeartbeatTimes = HeartbeatTimes {
        interval: Duration::from_millis(20),
        expiry: Duration::from_millis(300),
    };

    fn process(folder: &Path) -> Claims {
        let presence = Presence::announce(&folder.join("processes"), QUICK, OnFullDisk::Fail).unwrap();
        Claims::new(&folder.join("claims"), Arc::new(presence)).unwrap()
    }

    fn taken(claims: &Claims, key: &str) -> Option<Claim> {
        claims.try_take(key).unwrap()
    }

    #[test]
    fn a_claim_has_one_owner_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let processes: Vec<Claims> = (0..4).map(|_| process(folder.path())).collect();
        let (held, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for claims in &processes {
                let (held, done) = (&held, &done);
                scope.spawn(move || {
                    while done.load(Ordering::SeqCst) < 200 {
                        if let Some(_claim) = taken(claims, "key") {
                            assert_eq!(held.fetch_add(1, Ordering::SeqCst), 0);
                            std::thread::yield_now();
                            held.fetch_sub(1, Ordering::SeqCst);
                            done.fetch_add(1, Ordering::SeqCst);
                        }
                    }
                });
            }
        });
        assert_eq!(fs::read_dir(folder.path().join("claims")).unwrap().count(), 0);
    }

    #[test]
    fn a_claim_lasts_as_long_as_its_process() {
        let folder = tempfile::tempdir().unwrap();
        let (one, two) = (process(folder.path()), process(folder.path()));
        let claim = taken(&one, "key").unwrap();
        assert!(taken(&one, "key").is_none(), "another thread of the same process");
        std::thread::sleep(2 * QUICK.expiry);
        assert!(taken(&two, "key").is_none(), "it shows itself");
        assert_eq!(two.owner("key").as_ref(), Some(one.presence.owner()));
        assert_eq!(two.owner("other"), None);
        drop(claim);
        let claim = taken(&two, "key").unwrap();
        // A process that is killed removes nothing; that it has ended is known here at once only of the same machine.
        std::mem::forget(claim);
        drop(two);
        assert!(taken(&one, "key").is_none(), "its name may only not be seen yet");
        std::thread::sleep(QUICK.expiry);
        assert!(taken(&one, "key").is_some());
    }

    #[test]
    fn a_claim_without_a_name_is_waited_for_and_then_ended() {
        let folder = tempfile::tempdir().unwrap();
        let one = process(folder.path());
        fs::create_dir(folder.path().join("claims/key")).unwrap();
        assert!(taken(&one, "key").is_none());
        std::thread::sleep(QUICK.expiry);
        assert!(taken(&one, "key").is_some());
    }
}
