//! Reads HDF5 files: trusted ones in this process, untrusted ones in a child process.
//!
//! libhdf5 is not robust against damaged or malicious files: a few changed bytes make it hang, crash or allocate all
//! memory. So untrusted files are opened by a child process of this program with limits on memory and time and without
//! plugins ([`HdfFile::open_untrusted`]), and its responses are limited and checked. Files whose bytes have been
//! verified with our own checksum are read in this process ([`HdfFile::open_trusted`]), by the same code.

mod attributes;
mod child;
mod elements;
mod error;
mod file;
mod limits;
mod links;
mod message;
mod open;
mod pool;
mod respond;
mod session;
mod storage;
mod tree;

pub use attributes::{AXES, LONG};
pub use child::{COMMAND, serve};
pub use elements::{Element, Elements};
pub use error::{Failure, HdfError, system_error};
pub use file::HdfFile;
pub use limits::{MEMORY, SECONDS};
pub use message::DatasetInfo;
pub use pool::restart_store_reader;
pub use session::{read_by_test, set_reader};
pub use tree::{Array, Tree};

#[cfg(test)]
mod tests;
