//! Writes a file that is no HDF5 file, and looks beforehand whether one can be written.

use std::path::Path;

use super::error::CliError;
use deaflow_base::{CsvTable, OutputFile, csv_metadata, csv_metadata_file, output_folder, write_output};

/// Refuses a path within a store, where files that are not its own would be damage.
///
/// # Errors
/// When it lies in one.
pub fn outside(path: &Path) -> Result<(), CliError> {
    match Store::around(path) {
        None => Ok(()),
        Some(store) => Err(
            CliError::bad_input(format!("{} lies in the store {}", path.display(), store.display()))
                .help("-o names a place outside: in a store are its own files alone"),
        ),
    }
}
use deaflow_store::Store;

/// Writes bytes as a file that appears complete or not at all.
///
/// # Errors
/// When something is there that is not to be replaced, the folder does not exist, or the system refuses.
pub fn file(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    Ok(write_output(path, bytes)?)
}

/// Writes comma-separated values with a header, and beside them what they are of and made from.
///
/// # Errors
/// As [`file()`].
pub fn csv(path: &Path, rows: &[u8], title: &str, source: &str) -> Result<(), CliError> {
    file(path, rows)?;
    let name = path.file_name().unwrap_or_default();
    let table = CsvTable {
        url: name.to_string_lossy().into_owned(),
        title: title.to_owned(),
        source: source.to_owned(),
        header: true,
    };
    file(&csv_metadata_file(path), &csv_metadata(&[table]))
}

/// Comma-separated values and what is said of them, as they are told of: both files.
pub fn with_metadata(path: &Path) -> String {
    let metadata = csv_metadata_file(path);
    let name = metadata.file_name().unwrap_or_default().to_string_lossy();
    format!("{} (described by {name})", path.display())
}

/// As [`check_file`], of comma-separated values and what is said of them.
///
/// # Errors
/// As [`file()`].
pub fn check_csv(path: &Path) -> Result<(), CliError> {
    check_file(path)?;
    check_file(&csv_metadata_file(path))
}

/// What cannot be written has to be known before hours of work, not after.
///
/// # Errors
/// As [`file()`].
pub fn check_file(path: &Path) -> Result<(), CliError> {
    outside(path)?;
    // Created and removed again: permissions alone do not tell whether a folder can be written in.
    Ok(output_folder(OutputFile::at(path)?.folder())?)
}

/// Makes a folder for several files, or sees that they can be written there.
///
/// # Errors
/// When something else is there, or the system refuses.
pub fn folder(path: &Path) -> Result<(), CliError> {
    outside(path)?;
    Ok(output_folder(path)?)
}
