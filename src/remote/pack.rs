//! Records in files: many in one, signed as a whole, so that what a thousand actions made takes one request.
//!
//! The file is the line `deaflow-records 1`, the signature of all that follows after that line, and the encoded records. Its name is
//! the digest of the whole file, under the key that has signed it.

use serde::{Deserialize, Serialize};

use super::error::RemoteError;
use super::key::{PublicKey, SIGNATURE, SigningKey};
use deaflow_base::{ArtifactId, Digest, decode, encode};
use deaflow_store::Record;

/// The folder of packs.
pub const RECORDS: &str = "records/";

/// What every pack begins with, and what is signed with it: a signature of something else is none of this.
const TITLE: &[u8] = b"deaflow-records 1\n";
const TITLE_OF_ANY: &[u8] = b"deaflow-records ";

/// No artifact is longer, bytes: what is said to be is not believed.
const LONGEST_ARTIFACT: u64 = 1 << 50;

/// Records of one pack.
pub const MOST_RECORDS: usize = 4096;

/// Bytes of the records of one pack beyond which another is begun; half of what can be encoded.
pub const MOST_BYTES: usize = 8 << 20;

/// A pack is no longer, bytes.
pub const LONGEST: u64 = (16 << 20) + 1024;

/// Chunks of a manifest that are told with its record; of more, the manifest itself is read.
const MOST_PARTS: usize = 1 << 18;

/// What its signer says of an action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Statement {
    /// What it made.
    pub record: Record,
    /// The chunks of that, where it is a manifest; not said of very many.
    pub parts: Option<Vec<ArtifactId>>,
}

impl Statement {
    /// A statement on an artifact with these chunks.
    pub fn new(record: Record, parts: &[ArtifactId]) -> Self {
        Self {
            record,
            parts: (parts.len() <= MOST_PARTS).then(|| parts.to_vec()),
        }
    }
}

/// Why a file is no pack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoPack {
    /// Its name is not its digest.
    Altered,
    /// Its signature is not that of the key.
    Unsigned,
    /// It does not hold records.
    Unreadable,
    /// Another version of this program has written it.
    OtherVersion,
}

/// The name of a pack.
pub fn name(signer: &PublicKey, digest: &Digest) -> String {
    format!("{RECORDS}{signer}/{digest}")
}

/// What a name under [`RECORDS`] says.
pub fn parse_name(name: &str) -> Option<(PublicKey, Digest)> {
    let (signer, digest) = name.strip_prefix(RECORDS)?.split_once('/')?;
    let (signer, digest) = (signer.parse().ok()?, digest.parse().ok()?);
    // Spelt in one way only.
    (self::name(&signer, &digest) == name).then_some((signer, digest))
}

/// Statements in packs of no more than fit.
///
/// # Errors
/// When a record is too large for any.
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

/// The file of a pack, and the digest that names it.
///
/// # Errors
/// When there are too many records.
pub fn write(statements: &[Statement], key: &SigningKey) -> Result<(Digest, Vec<u8>), RemoteError> {
    let body = encode(&statements)?;
    let signature = key.sign(&[TITLE, &body].concat());
    let file = [TITLE, &signature, &body].concat();
    Ok((Digest::of(&file), file))
}

/// What a pack says that must be of a signer, with records that say the action of their key and no others.
///
/// # Errors
/// When it is not what that signer has signed.
pub fn read(file: &[u8], signer: &PublicKey, digest: &Digest) -> Result<Vec<Statement>, NoPack> {
    if Digest::of(file) != *digest {
        return Err(NoPack::Altered);
    }
    let (signature, body) = split(file)?;
    if !signer.has_signed(&[TITLE, body].concat(), signature) {
        return Err(NoPack::Unsigned);
    }
    statements(body)
}

/// What a pack says, whoever has signed it.
///
/// # Errors
/// When it is none.
pub fn read_unsigned(file: &[u8]) -> Result<Vec<Statement>, NoPack> {
    statements(split(file)?.1)
}

fn split(file: &[u8]) -> Result<(&[u8], &[u8]), NoPack> {
    let rest = match file.strip_prefix(TITLE) {
        Some(rest) => rest,
        None if file.starts_with(TITLE_OF_ANY) => return Err(NoPack::OtherVersion),
        None => return Err(NoPack::Unreadable),
    };
    rest.split_at_checked(SIGNATURE).ok_or(NoPack::Unreadable)
}

fn statements(body: &[u8]) -> Result<Vec<Statement>, NoPack> {
    let mut statements: Vec<Statement> = decode(body).map_err(|_| NoPack::Unreadable)?;
    statements.retain(|statement| statement.record.size <= LONGEST_ARTIFACT && statement.record.is_of_its_action());
    Ok(statements)
}
