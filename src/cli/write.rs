//! Writes a file that is no HDF5 file, and looks beforehand whether one can be written.

use std::path::Path;

use super::error::CliError;
use crate::base::{OutputFile, output_folder, write_output};

/// Writes bytes as a file that appears complete or not at all.
///
/// # Errors
/// When something is there that is not to be replaced, the folder does not exist, or the system refuses.
pub fn file(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    Ok(write_output(path, bytes)?)
}

/// What cannot be written has to be known before hours of work, not after.
///
/// # Errors
/// As [`file()`].
pub fn check_file(path: &Path) -> Result<(), CliError> {
    // Created and removed again: permissions alone do not tell whether a folder can be written in.
    Ok(output_folder(OutputFile::at(path)?.folder())?)
}

/// Makes a folder for several files, or sees that they can be written there.
///
/// # Errors
/// When something else is there, or the system refuses.
pub fn folder(path: &Path) -> Result<(), CliError> {
    Ok(output_folder(path)?)
}
