//! Action records: which artifact an action made, and how long it took.
//!
//! A record is written after its artifact, so that it never refers to a missing one. It ends with its own digest, which
//! reveals damage. It contains the whole action: later runs compare the parameters, and a record is valid only if its
//! file name is the key of that action.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use super::action::Action;
use super::error::StoreError;
use deaflow_base::{ActionKey, ArtifactId, Digest, EncodingError, FileDigest, decode, encode, read_own};

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
    /// Returns the content of the file of the record: its encoding and the digest of that.
    pub(super) fn to_bytes(&self) -> Result<Vec<u8>, EncodingError> {
        let mut bytes = encode(self)?;
        bytes.extend_from_slice(Digest::of(&bytes).as_bytes());
        Ok(bytes)
    }

    /// Returns the digest of the encoding.
    pub(super) fn digest(&self) -> Result<Digest, EncodingError> {
        Ok(Digest::of(&encode(self)?))
    }

    /// Whether the key is that of the action.
    #[must_use]
    pub fn is_of_its_action(&self) -> bool {
        self.action.key().is_ok_and(|own| own == self.key)
    }
}
