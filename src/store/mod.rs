//! The content-addressed store: immutable HDF5 artifacts named by the digest of what they say, records of the actions
//! that made them, locks, and the check of the whole.

mod object;

pub use object::{Data, Dataset, Object, ObjectError, TEXT_WIDTH};
