//! The interface to object storage: names and bytes.

use std::path::Path;
use std::time::SystemTime;

use super::error::RemoteError;

/// An object in the storage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BucketObject {
    /// Name without the prefix of the remote.
    pub name: String,
    /// Length in bytes.
    pub size: u64,
    /// Time of the last change, by the clock of the storage.
    pub modified: SystemTime,
}

/// A local file that remembers a multipart upload, so that an interrupted one can resume.
pub struct UploadNote<'a> {
    /// Path of the file.
    pub path: &'a Path,
    /// Identifies the bytes that are sent: an upload of other bytes is not resumed.
    pub content: String,
}

/// Object storage under a prefix. Names are paths separated by `/`.
pub trait Bucket: Send + Sync {
    /// Returns the location for messages.
    fn place(&self) -> String;

    /// Lists all objects whose names start with `prefix`.
    ///
    /// # Errors
    /// Returns an error if the storage cannot be reached or refuses; so do all other methods.
    fn list(&self, prefix: &str) -> Result<Vec<BucketObject>, RemoteError>;

    /// Returns the bytes of an object, or `None` if it does not exist. More than `limit` bytes are an error.
    ///
    /// # Errors
    /// As [`Bucket::list`].
    fn get(&self, name: &str, limit: u64) -> Result<Option<Vec<u8>>, RemoteError>;

    /// Writes an object to a file and returns its length, or `None` if the object does not exist. More than `limit`
    /// bytes are an error.
    ///
    /// # Errors
    /// As [`Bucket::list`], or if the file cannot be written.
    fn get_file(&self, name: &str, target: &Path, limit: u64) -> Result<Option<u64>, RemoteError>;

    /// Writes an object.
    ///
    /// # Errors
    /// As [`Bucket::list`].
    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError>;

    /// Writes an object from a file of `size` bytes.
    ///
    /// # Errors
    /// As [`Bucket::list`], or if the file cannot be read.
    fn put_file(&self, name: &str, file: &Path, size: u64, note: &UploadNote<'_>) -> Result<(), RemoteError>;

    /// Removes an object. A missing object is not an error.
    ///
    /// # Errors
    /// As [`Bucket::list`].
    fn delete(&self, name: &str) -> Result<(), RemoteError>;

    /// Returns the time of the storage, or of this machine before the storage has sent a date.
    fn now(&self) -> SystemTime;
}
