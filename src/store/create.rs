//! HDF5 files that are made where no other process looks, and then moved into place.

use hdf5::FileBuilder;

/// A file to be made. It has no lock: a process that was started meanwhile has inherited the open file, and a lock with it, which
/// would outlive the writing.
pub fn new_file() -> FileBuilder {
    let mut builder = FileBuilder::new();
    builder.with_fapl(|access| access.file_locking(false));
    builder
}
