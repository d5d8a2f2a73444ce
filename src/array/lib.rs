//! Reads arrays of numbers from files of other programs: NumPy (`.npy`, `.npz`), HDF5, netCDF-4 and MATLAB 7.3, which
//! are HDF5.
//!
//! An [`ArrayFile`] finds arrays by name; an [`Array`] gives rows along its first axis. Files are not trusted: the size
//! of a file limits what its headers may claim, and HDF5 is read in a child process.

mod archive;
mod array;
mod error;
mod file;
mod format;
mod numpy;

pub use array::Array;
pub use error::ArrayError;
pub use file::ArrayFile;
pub use format::{Format, extension, split};
