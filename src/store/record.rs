//! Action records: what an action made, and at what cost.
//!
//! A record is written after its artifact, so that it never promises what is not there; it ends with a digest of itself,
//! so that a damaged record is no record. It says its action in full: the next run explains itself by the parameters, and a
//! record is believed only where its name is the key of that action.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use super::action::Action;
use super::atomic;
use super::error::StoreError;
use super::late;
use super::lock::{self, Guard};
use super::open::Store;
use deaflow_base::{ActionKey, ArtifactId, Digest, FileDigest, decode, encode, read_own};

/// What an action made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The action key.
    pub key: ActionKey,
    /// The action: what the key is made of.
    pub action: Action,
    /// The artifact that was made.
    pub artifact: ArtifactId,
    /// BLAKE3 of the artifact's file as it was written.
    pub file_digest: FileDigest,
    /// Length of that file in bytes.
    pub size: u64,
    /// What the work took, s.
    pub seconds: f64,
    /// How many samples have no stable solution.
    pub unstable: u64,
    /// When, in UTC, RFC 3339.
    pub created: String,
    /// Version of this crate.
    pub version: String,
    /// Architecture, operating system and processor.
    pub target: String,
}

/// What stands under a key.
#[derive(Clone, Debug)]
pub enum Lookup {
    /// No record: the action has not been done here.
    Absent,
    /// A file that is no record of this key, and counts as none; why.
    Damaged(&'static str),
    /// The record, and when it was written.
    Found(Box<Record>, SystemTime),
}

impl Lookup {
    /// The record, if there is a sound one.
    #[must_use]
    pub fn record(self) -> Option<Record> {
        match self {
            Self::Found(record, _) => Some(*record),
            Self::Absent | Self::Damaged(_) => None,
        }
    }
}

/// Why a file is no record.
const ALTERED: &str = "the record's bytes are not those that were written";

const TRAILER: usize = 32;

/// As much as can be encoded, and the trailer.
const MAX_BYTES: u64 = (16 << 20) + TRAILER as u64;

impl Store {
    /// Looks up what an action has made.
    ///
    /// # Errors
    /// When the system refuses; a damaged record is [`Lookup::Damaged`].
    pub fn record(&self, key: &ActionKey) -> Result<Lookup, StoreError> {
        Ok(self.or_record_elsewhere(read(&self.layout.record(key), key)?, key))
    }

    /// As [`Store::record`], of an action that this process alone may do now: what another has just written is seen.
    ///
    /// # Errors
    /// As [`Store::record`].
    pub fn record_now(&self, key: &ActionKey) -> Result<Lookup, StoreError> {
        let path = self.layout.record(key);
        if let found @ (Lookup::Found(..) | Lookup::Damaged(_)) = read(&path, key)? {
            return Ok(found);
        }
        late::refresh(path.parent().unwrap_or(self.root()));
        // Whether it is there at all; where not, nothing is waited for.
        let _ = late::if_listed(&path, || fs::symlink_metadata(&path));
        Ok(self.or_record_elsewhere(read(&path, key)?, key))
    }

    /// Writes a record. Its artifact must have been put, which makes it survive a crash of the machine; the record's own name
    /// may be lost in one until [`Store::settle_records`].
    ///
    /// # Errors
    /// When the system refuses.
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

    /// Makes all records that have been written survive a crash of the machine: once for many, since a record that is lost
    /// costs its work again and nothing else.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn settle_records(&self) -> Result<(), StoreError> {
        let folders = std::mem::take(&mut *self.unsettled());
        folders.iter().try_for_each(|folder| atomic::sync_folder(folder))
    }

    /// Waits until nobody else does this action, or until it is to wait no longer; none then.
    ///
    /// # Errors
    /// When the lock cannot be had.
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

    /// Whether another process or thread seems to be at this action, or at one that shares its lock file. It may be over when this is told.
    ///
    /// # Errors
    /// When the lock file cannot be opened.
    pub fn is_busy(&self, key: &ActionKey) -> Result<bool, StoreError> {
        match &self.hold.claims {
            Some(claims) => Ok(claims.owner(&key.to_string()).is_some()),
            None => lock::is_held(&self.layout.action_lock(key)),
        }
    }

    /// Who does this action, where another process does and that is known.
    pub fn who_does(&self, key: &ActionKey) -> Option<String> {
        self.hold.who_does(&self.layout, key)
    }

    /// Claims a name that others look at, unless another has it. None where processes keep apart by locks.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn try_reserve(&self, name: &str) -> Result<Option<Guard>, StoreError> {
        match &self.hold.claims {
            Some(claims) => Ok(claims.try_take(name)?.map(Guard::from)),
            None => Ok(None),
        }
    }

    /// The name of this process in the store, where processes show themselves there.
    #[must_use]
    pub fn process_name(&self) -> Option<&str> {
        self.hold.claims.as_ref().map(|claims| claims.process())
    }

    /// Takes the lock of an action unless another process or thread is doing it, or one that shares its lock file.
    ///
    /// # Errors
    /// When the lock file cannot be opened.
    pub fn try_lock_action(&self, key: &ActionKey) -> Result<Option<Guard>, StoreError> {
        let path = self.layout.action_lock(key);
        self.clear_file(&path)?;
        self.hold.try_action(&self.layout, key)
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
        Some(_) => Lookup::Damaged("its name is not the key of the action that it says"),
    })
}

fn parse(bytes: &[u8]) -> Option<Record> {
    let (body, trailer) = bytes.split_at_checked(bytes.len().checked_sub(TRAILER)?)?;
    (Digest::of(body).as_bytes() == trailer).then_some(())?;
    decode(body).ok()
}

/// Whether a record is that of a key: whoever can write a file can write any key into it, but not an action that has it.
fn is_of(record: &Record, key: &ActionKey) -> bool {
    record.key == *key && record.is_of_its_action()
}

impl Record {
    /// Whether its key is that of the action that it says.
    #[must_use]
    pub fn is_of_its_action(&self) -> bool {
        self.action.key().is_ok_and(|own| own == self.key)
    }
}
