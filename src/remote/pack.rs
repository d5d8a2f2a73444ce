//! Packs: signed files with many records, so that the records of a thousand actions take one request.
//!
//! A pack is the line `deaflow-records 1`, a signature of that line and the encoded records, and the encoded records.
//! Its name is the public key of the signer and the digest of the file.

use serde::{Deserialize, Serialize};

use super::error::RemoteError;
use super::key::{PublicKey, SIGNATURE, SigningKey};
use deaflow_base::{ArtifactId, Digest, decode, encode};
use deaflow_store::Record;

/// The folder of packs.
pub const RECORDS: &str = "records/";

/// First line of a pack. It is signed too, so that signatures of other data are not valid for packs.
const TITLE: &[u8] = b"deaflow-records 1\n";
const TITLE_OF_ANY: &[u8] = b"deaflow-records ";

/// Maximum size of an artifact in bytes; records of larger ones are dropped.
const MAX_ARTIFACT: u64 = 1 << 50;

/// Maximum number of records in a pack.
pub const MOST_RECORDS: usize = 4096;

/// Maximum size of the records in a pack in bytes; half of what can be encoded.
pub const MOST_BYTES: usize = 8 << 20;

/// Maximum size of a pack in bytes.
pub const MAX_PACK: u64 = (16 << 20) + 1024;

/// Maximum number of chunks that are listed with the record of a manifest; for more, the manifest itself is read.
const MOST_PARTS: usize = 1 << 18;

/// A record with the chunks of its artifact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Statement {
    /// The record of an action.
    pub record: Record,
    /// Chunks of the artifact if it is a manifest; `None` if there are too many.
    pub parts: Option<Vec<ArtifactId>>,
}

impl Statement {
    /// Creates the statement for an artifact with these chunks.
    pub fn new(record: Record, parts: &[ArtifactId]) -> Self {
        Self {
            record,
            parts: (parts.len() <= MOST_PARTS).then(|| parts.to_vec()),
        }
    }
}

/// Why a file of records is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
pub enum PackError {
    /// The name is not that of a pack.
    #[error("not a name of a file of records")]
    BadName,
    /// The file is longer than a pack can be.
    #[error("the file is too long")]
    TooLong,
    /// The name differs from the digest.
    #[error("its content was changed")]
    Altered,
    /// The signature is not valid for the key.
    #[error("its signature is not valid for the key in its name")]
    Unsigned,
    /// The file does not contain records.
    #[error("it contains no records that this version can read")]
    Unreadable,
    /// The file was written by another version of deaflow.
    #[error("it was written by another version of deaflow")]
    OtherVersion,
}

/// Returns the name of a pack.
pub fn name(signer: &PublicKey, digest: &Digest) -> String {
    format!("{RECORDS}{signer}/{digest}")
}

/// Parses the name of a pack.
pub fn parse_name(name: &str) -> Option<(PublicKey, Digest)> {
    let (signer, digest) = name.strip_prefix(RECORDS)?.split_once('/')?;
    let (signer, digest) = (signer.parse().ok()?, digest.parse().ok()?);
    // Only one spelling is valid.
    (self::name(&signer, &digest) == name).then_some((signer, digest))
}

/// Divides statements into packs of allowed size.
///
/// # Errors
/// Returns an error if a record cannot be encoded.
pub fn divide(statements: Vec<Statement>) -> Result<Vec<Vec<Statement>>, RemoteError> {
    let mut packs = vec![Vec::new()];
    let mut bytes = 0;
    for statement in statements {
        let length = encode(&statement)?.len();
        let last = packs.last().map_or(0, Vec::len);
        if last >= MOST_RECORDS || last > 0 && bytes + length > MOST_BYTES {
            packs.push(Vec::new());
            bytes = 0;
        }
        bytes += length;
        if let Some(pack) = packs.last_mut() {
            pack.push(statement);
        }
    }
    packs.retain(|pack| !pack.is_empty());
    Ok(packs)
}

/// Encodes and signs a pack; returns its digest and its bytes.
///
/// # Errors
/// Returns an error if there are too many records.
pub fn write(statements: &[Statement], key: &SigningKey) -> Result<(Digest, Vec<u8>), RemoteError> {
    let body = encode(&statements)?;
    let signature = key.sign(&[TITLE, &body].concat());
    let file = [TITLE, &signature, &body].concat();
    Ok((Digest::of(&file), file))
}

/// Reads a pack and verifies its digest and signature. Records whose key does not match their action are dropped.
///
/// # Errors
/// Returns an error if the pack is invalid.
pub fn read(file: &[u8], signer: &PublicKey, digest: &Digest) -> Result<Vec<Statement>, PackError> {
    if Digest::of(file) != *digest {
        return Err(PackError::Altered);
    }
    let (signature, body) = split(file)?;
    if !signer.has_signed(&[TITLE, body].concat(), signature) {
        return Err(PackError::Unsigned);
    }
    statements(body)
}

/// Reads a pack without verifying the signature.
///
/// # Errors
/// Returns an error if the pack is invalid.
pub fn read_unsigned(file: &[u8]) -> Result<Vec<Statement>, PackError> {
    statements(split(file)?.1)
}

fn split(file: &[u8]) -> Result<(&[u8], &[u8]), PackError> {
    let rest = match file.strip_prefix(TITLE) {
        Some(rest) => rest,
        None if file.starts_with(TITLE_OF_ANY) => return Err(PackError::OtherVersion),
        None => return Err(PackError::Unreadable),
    };
    rest.split_at_checked(SIGNATURE).ok_or(PackError::Unreadable)
}

fn statements(body: &[u8]) -> Result<Vec<Statement>, PackError> {
    let mut statements: Vec<Statement> = decode(body).map_err(|_| PackError::Unreadable)?;
    statements.retain(|statement| statement.record.size <= MAX_ARTIFACT && statement.record.is_of_its_action());
    Ok(statements)
}
