//! Creates HDF5 files that no other process opens until they are moved into place.

use hdf5::FileBuilder;

/// Returns a builder for a file without a lock: a child process that is started meanwhile would inherit the lock and
/// hold it for longer than the write takes.
pub fn new_file() -> FileBuilder {
    let mut builder = FileBuilder::new();
    builder.with_fapl(|access| access.file_locking(false));
    builder
}
