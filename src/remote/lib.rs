//! A store that others share over the network: push and pull of objects and of signed records, on any S3-compatible storage.
//!
//! ```text
//! PREFIX/format                          `deaflow-remote 1`
//! PREFIX/objects/ab/<digest>.h5          artifacts by the digest of their content, as in a store
//! PREFIX/records/<public key>/<digest>   what actions made, many in one signed file
//! ```
//!
//! Whoever may write there may put anything there: a record counts where a key that the user trusts has signed it, and an object
//! where its content has the digest that is its name. Objects come before the records that name them, so that the remote
//! is sound at any moment and an interrupted push goes on where it stopped.

mod bucket;
mod config;
mod credentials;
mod error;
mod gc;
mod key;
mod known;
mod pack;
mod pull;
mod push;
mod s3;
mod upload;
mod upstream;

#[cfg(test)]
mod tests;

pub use bucket::{Bucket, Entry, Unfinished};
pub use config::{Address, Configuration, Configured};
pub use error::RemoteError;
pub use gc::{Retention, Swept, sweep};
pub use key::{Named, PublicKey, SigningKey, read_public};
pub use known::{Disagreement, Foreign, Known, Said};
pub use pull::{Pulled, pull_all, pull_some};
pub use push::{Push, Pushed, push};
pub use s3::S3;
pub use upstream::{Brought, Remote};
