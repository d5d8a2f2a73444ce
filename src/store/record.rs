//! Action records: which artifact an action made, and how long it took.
//!
//! A record is written after its artifact, so that it never refers to a missing one. It ends with its own digest, which
//! reveals damage. It contains the whole action: later runs compare the parameters, and a record is valid only if its file
//! name is the key of that action.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use super::action::Action;
use super::atomic;
use super::delayed_names;
use super::error::StoreError;
use super::lock::{self, Guard};
use super::open::Store;
use deaflow_base::{ActionKey, ArtifactId, Digest, FileDigest, decode, encode, read_own};

/// The result of an action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The action key.
    pub key: ActionKey,
    /// The action, from which the key is computed.
    pub action: Action,
    /// The artifact that was made.
    pub artifact: ArtifactId,
    /// BLAKE3 digest of the file of the artifact.
    pub file_digest: FileDigest,
    /// Length of that file in bytes.
    pub size: u64,
    /// Duration of the work, s.
    pub seconds: f64,
    /// Number of samples without a stable solution.
    pub unstable: u64,
    /// Time in UTC, RFC 3339.
    pub created: String,
    /// Version of the program.
    pub version: String,
    /// Architecture, operating system and processor.
    pub target: String,
}

/// The result of looking up a key.
#[derive(Clone, Debug)]
pub enum Lookup {
    /// There is no record.
    Absent,
    /// The file is not a valid record of this key, and is ignored; with the reason.
    Damaged(&'static str),
    /// The record, and when its file was written.
    Found(Box<Record>, SystemTime),
}

impl Lookup {
    /// Returns the record if there is a valid one.
    #[must_use]
    pub fn record(self) -> Option<Record> {
        match self {
            Self::Found(record, _) => Some(*record),
            Self::Absent | Self::Damaged(_) => None,
        }
    }
}

const ALTERED: &str = "the bytes of the record have changed";

const TRAILER: usize = 32;

/// The largest encoded record and the trailer.
const MAX_BYTES: u64 = (16 << 20) + TRAILER as u64;

impl Store {
    /// Looks up the record of an action.
    ///
    /// # Errors
    /// If the system reports an error; a damaged record is [`Lookup::Damaged`].
    pub fn record(&self, key: &ActionKey) -> Result<Lookup, StoreError> {
        Ok(self.or_record_elsewhere(read(&self.layout.record(key), key)?, key))
    }

    /// As [`Store::record`], for an action that this process has locked: also sees a record that another process has just written.
    ///
    /// # Errors
    /// As [`Store::record`].
    pub fn record_now(&self, key: &ActionKey) -> Result<Lookup, StoreError> {
        let path = self.layout.record(key);
        if let found @ (Lookup::Found(..) | Lookup::Damaged(_)) = read(&path, key)? {
            return Ok(found);
        }
        delayed_names::refresh(path.parent().unwrap_or(self.root()));
        // Waits only if the folder lists the record.
        let _ = delayed_names::if_listed(&path, || fs::symlink_metadata(&path));
        Ok(self.or_record_elsewhere(read(&path, key)?, key))
    }

    /// Writes a record. Its artifact must have been written before. A crash of the machine may lose the record until
    /// [`Store::settle_records`].
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn put_record(&self, record: &Record) -> Result<(), StoreError> {
        let mut bytes = encode(record)?;
        bytes.extend_from_slice(Digest::of(&bytes).as_bytes());
        let target = self.layout.record(&record.key);
        self.clear_folder(target.parent().unwrap_or(self.root()))?;
        if matches!(self.record(&record.key)?, Lookup::Damaged(_)) {
            self.quarantine(&target)?;
        }
        let temporary = self.temporary_file()?;
        atomic::write_unsettled(&temporary, &target, &bytes)?;
        let folder = target.parent().map(Path::to_owned);
        self.unsettled().extend(folder);
        Ok(())
    }

    /// Syncs the folders of all records that were written. Once for many is enough: a lost record only costs repeated work.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn settle_records(&self) -> Result<(), StoreError> {
        let folders = std::mem::take(&mut *self.unsettled());
        folders.iter().try_for_each(|folder| atomic::sync_folder(folder))
    }

    /// Waits for the lock of an action; returns `None` as soon as `stopped` returns true.
    ///
    /// # Errors
    /// If the lock file cannot be opened.
    pub fn lock_action(&self, key: &ActionKey, stopped: &dyn Fn() -> bool) -> Result<Option<Guard>, StoreError> {
        let mut pause = Duration::from_millis(5);
        loop {
            if let Some(guard) = self.try_lock_action(key)? {
                return Ok(Some(guard));
            }
            if stopped() {
                return Ok(None);
            }
            std::thread::sleep(pause);
            pause = (2 * pause).min(Duration::from_secs(1));
        }
    }

    /// Whether another process or thread is running this action, or one that shares its lock file. That may have changed
    /// when this returns.
    ///
    /// # Errors
    /// If the lock file cannot be opened.
    pub fn is_busy(&self, key: &ActionKey) -> Result<bool, StoreError> {
        match &self.session.claims {
            Some(claims) => Ok(claims.owner(&key.to_string()).is_some()),
            None => lock::is_held(&self.layout.action_lock(key)),
        }
    }

    /// Returns a description of the process that runs this action, if known.
    pub fn action_owner(&self, key: &ActionKey) -> Option<String> {
        self.session.action_owner(&self.layout, key)
    }

    /// Claims a name unless another process has it. Always `None` if the store uses file locks.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn try_reserve(&self, name: &str) -> Result<Option<Guard>, StoreError> {
        match &self.session.claims {
            Some(claims) => Ok(claims.try_take(name)?.map(Guard::from)),
            None => Ok(None),
        }
    }

    /// Returns the name of this process in the store, if the store uses claims.
    #[must_use]
    pub fn process_name(&self) -> Option<&str> {
        self.session.claims.as_ref().map(|claims| claims.process())
    }

    /// Takes the lock of an action unless another process or thread has it, or that of one that shares its lock file.
    ///
    /// # Errors
    /// If the lock file cannot be opened.
    pub fn try_lock_action(&self, key: &ActionKey) -> Result<Option<Guard>, StoreError> {
        let path = self.layout.action_lock(key);
        self.clear_file(&path)?;
        self.session.try_action(&self.layout, key)
    }
}

pub(super) fn read(path: &Path, key: &ActionKey) -> Result<Lookup, StoreError> {
    let bytes = match read_own(path, MAX_BYTES) {
        Ok(bytes) => bytes,
        Err(error) => {
            return match error.kind() {
                ErrorKind::NotFound | ErrorKind::StaleNetworkFileHandle => Ok(Lookup::Absent),
                ErrorKind::InvalidInput | ErrorKind::FileTooLarge => Ok(Lookup::Damaged(ALTERED)),
                _ => Err(StoreError::io("read", path)(error)),
            };
        }
    };
    let written = fs::metadata(path)
        .and_then(|metadata| metadata.modified())
        .map_err(StoreError::io("read", path))?;
    Ok(match parse(&bytes) {
        None => Lookup::Damaged(ALTERED),
        Some(record) if is_of(&record, key) => Lookup::Found(Box::new(record), written),
        Some(_) => Lookup::Damaged("its file name is not the key of its action"),
    })
}

fn parse(bytes: &[u8]) -> Option<Record> {
    let (body, trailer) = bytes.split_at_checked(bytes.len().checked_sub(TRAILER)?)?;
    (Digest::of(body).as_bytes() == trailer).then_some(())?;
    decode(body).ok()
}

/// Whether a record is that of a key. A forger can write any key into a file, but cannot find an action with that key.
fn is_of(record: &Record, key: &ActionKey) -> bool {
    record.key == *key && record.is_of_its_action()
}

impl Record {
    /// Whether the key is that of the action.
    #[must_use]
    pub fn is_of_its_action(&self) -> bool {
        self.action.key().is_ok_and(|own| own == self.key)
    }
}
