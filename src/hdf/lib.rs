//! Reads HDF5 files: those of this program here, those of others in a process apart.
//!
//! libhdf5 is not made for files that were damaged or made to do harm: a few changed bytes let it hang, crash or ask for all memory.
//! So a file that is not known to be ours is opened by a child process of this program, with little memory, against the clock and
//! without plugins ([`HdfFile::apart`]); what comes back is bounded and checked. Files whose every byte has been compared with
//! a checksum of our own are read in this process ([`HdfFile::here`]), by the same code.

mod answer;
mod attributes;
mod child;
mod elements;
mod error;
mod file;
mod limits;
mod message;
mod open;
mod pool;
mod session;
mod storage;
mod tree;

pub use attributes::{AXES, LONG};
pub use child::{COMMAND, serve};
pub use elements::{Element, Elements};
pub use error::{Failure, HdfError};
pub use file::HdfFile;
pub use limits::{MEMORY, SECONDS};
pub use message::Found;
pub use session::{read_by_test, set_reader};
pub use tree::{Array, Tree};

#[cfg(test)]
mod tests;
