//! Files that are no artifacts: results that somebody asked for by name. They look like artifacts to HDF5 tools, but
//! have no header, may hold NaN, and are wherever the user wants them.

use std::fs::File;
use std::path::Path;

use super::atomic;
use super::error::StoreError;
use super::listing;
use super::object::Object;
use super::provenance::Provenance;
use super::write;
use deaflow_base::{OutputFile, TemporaryOutput};

/// Writes arrays to an HDF5 file atomically, replacing an existing file.
///
/// # Errors
/// If the folder does not exist or cannot be written in, or the library reports an error (disk full).
pub fn write_file(path: &Path, object: &Object, provenance: &Provenance) -> Result<(), StoreError> {
    let contents = listing::of_object(object).contents;
    place(path, |file| {
        write::write(file, object, &[], &contents, provenance).map_err(StoreError::hdf5("write", path))
    })
}

/// Calls `write` with the path of a temporary file and moves that to `path`.
///
/// # Errors
/// If the folder does not exist or cannot be written in, or `write` fails.
pub(super) fn place(path: &Path, write: impl FnOnce(&Path) -> Result<(), StoreError>) -> Result<(), StoreError> {
    let output = OutputFile::new(path)?;
    // In the same folder, so that it is on the same file system.
    let folder = output.folder();
    let temporary = TemporaryOutput::inside(folder).map_err(StoreError::io("write in", folder))?;
    let file = temporary.path().join("result.h5");
    write(&file)?;
    // A full disk must not destroy the existing file.
    let synced = File::open(&file).and_then(|file| file.sync_all());
    synced.map_err(StoreError::io("write", path))?;
    output.recheck()?;
    atomic::rename(&file, output.target())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Data, Dataset};

    #[test]
    fn a_plain_file_may_hold_nan_and_replaces_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.h5");
        for value in [1.0, f64::NAN] {
            let object = Object::default().with("v", Dataset::new("mm", "d", &[2], Data::F64(vec![value, 2.0])));
            write_file(&path, &object, &Provenance::default()).unwrap();
        }
        let values = hdf5::File::open(&path)
            .unwrap()
            .dataset("v")
            .unwrap()
            .read_raw::<f64>()
            .unwrap();
        assert!(values[0].is_nan() && values[1] == 2.0);
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            1,
            "no temporary file stays"
        );
        let nowhere = folder.path().join("none/out.h5");
        assert!(write_file(&nowhere, &Object::default(), &Provenance::default()).is_err());
    }
}
