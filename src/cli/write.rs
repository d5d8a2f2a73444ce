//! Writes files that are not HDF5, and checks in advance that a file can be written.

use std::path::{Path, PathBuf};

use super::{CliError, Output};
use deaflow_base::{CsvColumn, CsvTable, OutputFile, csv_metadata, csv_metadata_file, output_folder, write_output};
use deaflow_report::figures::FigureError;
use deaflow_store::Store;

/// Refuses a path inside a store: a foreign file there counts as damage.
///
/// # Errors
/// When it is inside one.
pub fn outside(path: &Path) -> Result<(), CliError> {
    match Store::around(path) {
        None => Ok(()),
        Some(store) => Err(
            CliError::bad_input(format!("{} is inside the store {}", path.display(), store.display()))
                .help("choose a path outside the store with -o"),
        ),
    }
}

/// Writes a file atomically.
///
/// # Errors
/// When something is there that must not be replaced, the folder does not exist, or the system refuses.
pub fn file(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    Ok(write_output(path, bytes)?)
}

/// Draws a figure into a file, which accompanies results: if that fails, this warns, and returns `None`.
pub fn drawn(path: PathBuf, draw: impl FnOnce(&Path) -> Result<(), FigureError>, output: &Output) -> Option<PathBuf> {
    match draw(&path) {
        Ok(()) => Some(path),
        Err(error) => {
            output.warn(format_args!("there is no figure {}: {error}", path.display()));
            None
        }
    }
}

/// Writes comma-separated values with a header, and a metadata file with their title, source and columns, whose names
/// end with their units.
///
/// # Errors
/// As [`file()`].
pub fn csv(path: &Path, rows: &[u8], title: &str, source: &str) -> Result<(), CliError> {
    let mut reader = csv::Reader::from_reader(rows);
    let header = reader.headers();
    let header = header.map_err(|error| CliError::failure(format!("cannot describe {}: {error}", path.display())))?;
    csv_of(
        path,
        rows,
        (title, source),
        header.iter().map(CsvColumn::of_title).collect(),
    )
}

/// Like [`csv()`], with other columns.
///
/// # Errors
/// As [`file()`].
pub fn csv_of(
    path: &Path,
    rows: &[u8],
    (title, source): (&str, &str),
    columns: Vec<CsvColumn>,
) -> Result<(), CliError> {
    file(path, rows)?;
    let name = path.file_name().unwrap_or_default();
    let table = CsvTable {
        url: name.to_string_lossy().into_owned(),
        title: title.to_owned(),
        source: source.to_owned(),
        header: true,
        columns,
    };
    file(&csv_metadata_file(path), &csv_metadata(&[table]))
}

/// Names a CSV file and its metadata file.
pub fn with_metadata(path: &Path) -> String {
    let metadata = csv_metadata_file(path);
    let name = metadata.file_name().unwrap_or_default().to_string_lossy();
    format!("{} (described by {name})", path.display())
}

/// Checks that comma-separated values and their metadata can be written, before the work starts.
///
/// # Errors
/// When the path has the extension of a picture or of HDF5; as [`file()`].
pub fn check_csv(path: &Path) -> Result<(), CliError> {
    const OTHERS: [&str; 8] = ["png", "svg", "pdf", "jpg", "h5", "hdf5", "yaml", "json"];
    let extension = path.extension().and_then(|extension| extension.to_str());
    if extension.is_some_and(|extension| OTHERS.iter().any(|other| extension.eq_ignore_ascii_case(other))) {
        let message = format!("a table is written as CSV, and {} is no CSV file", path.display());
        return Err(CliError::bad_input(message).help(format!("name it {}", path.with_extension("csv").display())));
    }
    check_file(path)?;
    check_file(&csv_metadata_file(path))
}

/// Refuses the file of a figure that has no extension of PNG.
///
/// # Errors
/// When it has another one, or none.
pub fn check_png(path: &Path) -> Result<(), CliError> {
    if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    let message = format!("a figure is written as PNG, and {} is no PNG file", path.display());
    Err(CliError::bad_input(message).help(format!("name it {}", path.with_extension("png").display())))
}

/// Checks that a file can be written, before the work starts.
///
/// # Errors
/// As [`file()`].
pub fn check_file(path: &Path) -> Result<(), CliError> {
    outside(path)?;
    let is_hdf5 = |extension| ["h5", "hdf5", "vtkhdf"].iter().any(|hdf5| extension == *hdf5);
    if path.extension().is_none_or(is_hdf5) {
        check_hdf5(path)?;
    }
    // This creates and removes a file there: permissions do not tell whether a folder is writable.
    Ok(output_folder(OutputFile::new(path)?.folder())?)
}

/// Refuses a path where HDF5 cannot write.
///
/// # Errors
/// When it is not UTF-8.
pub fn check_hdf5(path: &Path) -> Result<(), CliError> {
    match path.to_str() {
        Some(_) => Ok(()),
        None => Err(CliError::bad_input(format!(
            "the path {} is not UTF-8, so HDF5 cannot write there",
            path.display()
        ))
        .help("name another with -o")),
    }
}

/// Checks that a file can be written and is not one of the inputs.
///
/// # Errors
/// As [`check_not_read`] and [`file()`].
pub fn check_output(path: &Path, inputs: &[String]) -> Result<(), CliError> {
    check_not_read(path, inputs)?;
    check_file(path)
}

/// Refuses to overwrite a file that one of these arguments names.
///
/// # Errors
/// When one does.
pub fn check_not_read(path: &Path, inputs: &[impl AsRef<str>]) -> Result<(), CliError> {
    let mut files = inputs.iter().flat_map(|input| files_named(input.as_ref()));
    match files.any(|file| is_same_file(&file, path)) {
        true => Err(
            CliError::bad_input(format!("{} is an input: it would be overwritten", path.display()))
                .help("name another file"),
        ),
        false => Ok(()),
    }
}

/// The files that an argument may name: itself, and the part before each colon (`FILE.h5:/dataset`, `PIPELINE:STAGE`).
fn files_named(argument: &str) -> impl Iterator<Item = PathBuf> {
    let ends = argument.match_indices(':').map(|(at, _)| at).chain([argument.len()]);
    ends.map(|end| PathBuf::from(&argument[..end]))
}

/// Whether two paths lead to the same file or folder.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Makes a folder for several files, or checks that it is writable.
///
/// # Errors
/// When something else is there, or the system refuses.
pub fn folder(path: &Path) -> Result<(), CliError> {
    outside(path)?;
    Ok(output_folder(path)?)
}
