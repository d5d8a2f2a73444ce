//! Sharing of a store over the network: push and pull of objects and of signed records on any S3-compatible storage.
//!
//! ```text
//! PREFIX/format                          `deaflow-remote 1`
//! PREFIX/objects/ab/<digest>.h5          artifacts by the digest of their content, as in a store
//! PREFIX/records/<public key>/<digest>   records of actions, many in one signed file
//! ```
//!
//! Everybody with write access can put anything there. A record is used only if a trusted key has signed it, and an
//! object only if its content has the digest in its name. Objects are written before the records that name them, so
//! that the remote is consistent at any moment and the next push continues after an interruption.

mod bucket;
mod config;
mod credentials;
mod error;
mod gc;
mod key;
mod objects;
mod paced;
mod pack;
mod pull;
mod push;
mod s3;
mod trusted_records;
mod upload;
mod upstream;

#[cfg(test)]
mod tests;

pub use bucket::{Bucket, BucketObject, UploadNote};
pub use config::{Address, Configuration, RemoteConfiguration};
pub use error::RemoteError;
pub use gc::{GarbageReport, Retention, collect_garbage};
pub use key::{PublicKey, SigningKey, TrustedKey, read_public_keys};
pub use pack::PackError;
pub use pull::{PullReport, pull_all, pull_some};
pub use push::{Push, PushReport, push};
pub use s3::S3;
pub use trusted_records::{Disagreement, IgnoredRecords, SignedResult, TrustedRecords};
pub use upstream::{Downloads, Remote};
