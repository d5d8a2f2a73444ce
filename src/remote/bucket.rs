//! What is asked of storage: names and bytes, and no more.

use std::path::Path;
use std::time::SystemTime;

use super::error::RemoteError;

/// An object of the storage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its name, without the prefix of the remote.
    pub name: String,
    /// Its length, bytes.
    pub size: u64,
    /// When it was written, by the clock of the storage.
    pub modified: SystemTime,
}

/// Where a large file that is sent in pieces is remembered, so that an interrupted upload goes on.
pub struct Unfinished<'a> {
    /// A file of ours.
    pub note: &'a Path,
    /// What the bytes are that are sent: pieces of another file are of no use.
    pub content: String,
}

/// Storage under a prefix. Names are paths with `/`.
pub trait Bucket: Send + Sync {
    /// Where it is, for people.
    fn place(&self) -> String;

    /// All objects whose names begin so.
    ///
    /// # Errors
    /// When the storage cannot be reached or refuses; so with all others.
    fn list(&self, prefix: &str) -> Result<Vec<Entry>, RemoteError>;

    /// The bytes of an object, of which there may be at most `limit`; none where there is no such object.
    ///
    /// # Errors
    /// As [`Bucket::list`].
    fn get(&self, name: &str, limit: u64) -> Result<Option<Vec<u8>>, RemoteError>;

    /// Writes the bytes of an object, of which there may be at most `limit`, into a file, and says how many there were; none where
    /// there is no such object.
    ///
    /// # Errors
    /// As [`Bucket::list`], or when the file cannot be written.
    fn get_file(&self, name: &str, target: &Path, limit: u64) -> Result<Option<u64>, RemoteError>;

    /// Writes an object.
    ///
    /// # Errors
    /// As [`Bucket::list`].
    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError>;

    /// Writes an object from a file of this length.
    ///
    /// # Errors
    /// As [`Bucket::list`], or when the file cannot be read.
    fn put_file(&self, name: &str, file: &Path, size: u64, unfinished: &Unfinished<'_>) -> Result<(), RemoteError>;

    /// Removes an object; that there is none is no error.
    ///
    /// # Errors
    /// As [`Bucket::list`].
    fn delete(&self, name: &str) -> Result<(), RemoteError>;

    /// The time by the clock of the storage, as far as it has told; that of this machine else.
    fn now(&self) -> SystemTime;
}
