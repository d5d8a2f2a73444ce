//! Claims on pieces of work, where locks of one machine are not seen by another.
//!
//! A claim is a folder `locks/claims/<key>`, since of all who make one folder at once one succeeds on every file system, with a
//! file `owner` in it that names a process ([`Presence`]). It lasts until its process removes it or is dead.

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

/// The name of a process is shorter, bytes.
const LONGEST: u64 = 64;

/// Between two looks at a folder that is not seen yet.
const PAUSE: Duration = Duration::from_millis(50);

/// How often a folder that comes and goes is tried.
const ATTEMPTS: usize = 2000;

/// The claims of a store.
#[derive(Clone)]
pub struct Claims {
    folder: PathBuf,
    presence: Arc<Presence>,
}

/// A claim of this process; it ends when this is dropped.
pub struct Claim {
    folder: PathBuf,
    /// Name of this process.
    process: String,
}

impl Claims {
    /// The claims in a folder, which is made where there is none.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn new(folder: &Path, presence: Arc<Presence>) -> Result<Self, StoreError> {
        delayed_names::make_folders(folder).map_err(StoreError::io("create", folder))?;
        Ok(Self {
            folder: folder.to_owned(),
            presence,
        })
    }

    /// Name of this machine.
    pub fn host(&self) -> &str {
        &self.presence.owner().host
    }

    /// Name of this process in the store.
    pub fn process(&self) -> &str {
        self.presence.name()
    }

    /// Ends all claims of this process, and its sign of life. What cannot be removed is waited for.
    pub fn leave(&self) {
        let _ = self.clear(&[self.presence.name()]);
        self.presence.remove_process(self.presence.name());
    }

    /// Who has a piece of work, where somebody has it and that is known.
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

    /// Claims a piece of work unless a living process has it, or another thread of this one.
    ///
    /// # Errors
    /// When the system refuses.
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
                        // Somebody has waited for the name for long, and has ended the claim.
                        Err(error) if delayed_names::is_late(&error) => std::thread::sleep(PAUSE),
                        Err(error) => {
                            // A full disk: without a name it would be waited for.
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
                        // Its process may be about to write its name; the next claim on the same is another.
                        "" => self.presence.state_of(key, made(&path)),
                        process => self.presence.process_state(process),
                    };
                    match life {
                        ProcessState::Alive(_) => return Ok(None),
                        ProcessState::Dead(_) => self.evict(&path, &process)?,
                    }
                }
                // The folder is gone, or its name is stale.
                Err(error) if delayed_names::is_late(&error) => {
                    delayed_names::make_folders(&self.folder).map_err(StoreError::io("create", &self.folder))?;
                    std::thread::sleep(PAUSE);
                }
                Err(error) => return Err(StoreError::io("claim", &path)(error)),
            }
        }
        Ok(None)
    }

    /// Ends the claims of processes that are dead.
    ///
    /// # Errors
    /// When the system refuses.
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

    /// Ends the claim of a dead process. Moved first: of several who try one succeeds, and who comes late does not end the claim that
    /// followed.
    fn evict(&self, path: &Path, process: &str) -> Result<(), StoreError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let aside = self.folder.join(format!("{name}.{}", self.presence.name()));
        match fs::rename(path, &aside) {
            Ok(()) if process_of(&aside) == process => remove(&aside),
            Ok(()) => {
                // It had been claimed again meanwhile. Where that cannot be put back, its work may be done twice, to the same end.
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
        // Another may have thought this process dead, and have it now. What cannot be removed ends with its process.
        if process_of(&self.folder) == self.process {
            let _ = remove(&self.folder);
        }
    }
}

/// What tells a claim from the next one on the same piece of work.
fn made(claim: &Path) -> Vec<u8> {
    let metadata = fs::symlink_metadata(claim);
    metadata.map_or_else(|_| Vec::new(), |found| format!("{:?}", Stamp::of(&found)).into_bytes())
}

fn process_of(claim: &Path) -> String {
    let bytes = read_own(&claim.join(OWNER), LONGEST).unwrap_or_default();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The name before the folder: a claim without a name is nobody's to others.
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
    use crate::presence::HeartbeatTimes;

    const QUICK: HeartbeatTimes = HeartbeatTimes {
        interval: Duration::from_millis(20),
        expiry: Duration::from_millis(300),
    };

    fn process(folder: &Path) -> Claims {
        let presence = Presence::announce(&folder.join("processes"), QUICK).unwrap();
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
