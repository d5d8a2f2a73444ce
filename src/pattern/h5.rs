//! Reads patterns from a dataset of an HDF5 file: `FILE.h5:/dataset`.

use std::path::Path;

use super::file::{PatternFileError, count, patterns, patterns_from};
use super::raster::{Pattern, PatternForm};
use deaflow_hdf::{Element, Failure, HdfError, HdfFile};

/// Cells read at a time: 8 MB of numbers.
const SLICE: usize = 1_000_000;

/// Splits `FILE.h5:/dataset`. Both parts may contain colons, so the split is after the extension of the file.
pub fn split(spec: &str) -> Option<(&str, &str)> {
    let lower = spec.to_ascii_lowercase();
    let after = |extension: &str| lower.rfind(&format!("{extension}:/")).map(|at| at + extension.len());
    let colon = after(".h5").into_iter().chain(after(".hdf5")).max()?;
    Some((&spec[..colon], &spec[colon + 1..]))
}

pub(super) fn read(path: &Path, dataset: &str, form: PatternForm) -> Result<Vec<Pattern>, PatternFileError> {
    let file = HdfFile::open_untrusted(path).map_err(refused)?;
    let found = file.find(dataset).map_err(|error| match error {
        HdfError::Failed {
            failure: Failure::Refused(why),
            ..
        } => PatternFileError::new(why).help("copy the dataset itself into the file, for example with h5py"),
        other => refused(other),
    })?;
    let Some(found) = found else {
        return Err(PatternFileError::new(format!("the file has no dataset {dataset:?}")).help(advice(path)));
    };
    let n = count(&found.shape, form)?;
    match found.element {
        Element::Other(what) => return Err(PatternFileError::new(format!("elements of type {what}")).help(TYPES)),
        element if !element.is_number() => return Err(PatternFileError::new("elements of type text").help(TYPES)),
        _ => {}
    }
    if found.shape.len() == 2 {
        return patterns(&file.numbers(dataset, 0..form.raster.rows()).map_err(refused)?, form);
    }
    let mut all = Vec::with_capacity(n);
    while all.len() < n {
        let rows = all.len()..n.min(all.len() + SLICE / form.raster.cells());
        let values = file.numbers(dataset, rows.clone()).map_err(refused)?;
        all.extend(patterns_from(&values, form, rows.start, n > 1)?);
    }
    Ok(all)
}

fn refused(error: HdfError) -> PatternFileError {
    PatternFileError::new(error.reason())
}

const TYPES: &str = "allowed: booleans, integers (1 to 8 bytes), floats (4 or 8 bytes)";

/// Returns how to name a dataset, with the datasets at the top of the file.
pub(super) fn advice(path: &Path) -> String {
    let names = HdfFile::open_untrusted(path)
        .and_then(|file| file.names())
        .unwrap_or_default();
    let mut text = "name a dataset, such as FILE.h5:/patterns".to_owned();
    if !names.is_empty() {
        let shown: Vec<String> = names.iter().take(12).map(|n| format!("/{n}")).collect();
        text += &format!("; the file contains {}", shown.join(", "));
    }
    text
}

#[cfg(test)]
pub(super) mod tests {
    use std::fs;

    use super::super::read::tests::{Folder, cells, wanted};
    use super::*;

    /// The bytes of a file that holds the wanted pattern as `/p`.
    pub fn sound(folder: &Folder) -> Vec<u8> {
        let path = folder.path("sound.h5");
        h5(&path, |file| {
            let dataset = file.new_dataset::<u8>().shape([50, 50]).create("p").unwrap();
            dataset.write_raw(wanted().cells()).unwrap();
        });
        fs::read(path).unwrap()
    }

    fn h5(path: &Path, write: impl Fn(&hdf5::File)) {
        write(&hdf5::File::create(path).unwrap());
    }

    #[test]
    fn datasets_of_hdf5_files() {
        let folder = Folder::new();
        h5(&folder.path("a:b.h5"), |file| {
            file.create_group("some").unwrap();
            let both = [wanted().cells(), wanted().cells()].concat();
            let flags: Vec<bool> = wanted().cells().iter().map(|&c| c == 1).collect();
            let write = |name: &str, shape: &[usize]| file.new_dataset::<u8>().shape(shape).create(name).unwrap();
            write("patterns", &[2, 50, 50]).write_raw(&both).unwrap();
            write("some/p:q", &[50, 50]).write_raw(wanted().cells()).unwrap();
            write("none", &[0, 50, 50]);
            write("flat", &[2500]);
            file.new_dataset::<f64>()
                .shape([50, 50])
                .create("f")
                .unwrap()
                .write_raw(&cells())
                .unwrap();
            file.new_dataset::<bool>()
                .shape([50, 50])
                .create("bool")
                .unwrap()
                .write_raw(&flags)
                .unwrap();
            let halves: Vec<f32> = wanted().cells().iter().map(|&c| f32::from(c) / 2.0).collect();
            file.new_dataset::<f32>()
                .shape([50, 50])
                .create("half")
                .unwrap()
                .write_raw(&halves)
                .unwrap();
            let texts = [hdf5::types::FixedAscii::<4>::from_ascii("1").unwrap(); 2500];
            file.new_dataset::<hdf5::types::FixedAscii<4>>()
                .shape([50, 50])
                .create("text")
                .unwrap()
                .write_raw(&texts)
                .unwrap();
            let vast = file.new_dataset::<u8>().chunk([1, 50, 50]).shape([1 << 40, 50, 50]);
            vast.create("vast").unwrap();
        });
        assert_eq!(folder.read("a:b.h5:/patterns").unwrap(), [wanted(), wanted()]);
        for one in ["some/p:q", "f", "bool"] {
            assert_eq!(folder.read(&format!("a:b.h5:/{one}")).unwrap(), [wanted()], "{one}");
        }
        for (dataset, said) in [
            (":/none", "no pattern"),
            (":/flat", "shape (2500,)"),
            (":/half", "is 0.5"),
            (":/text", "elements of type"),
            (":/vast", "at most 20000"),
            (":/absent", "/patterns"),
            (":/some", "no dataset"),
            ("", "name a dataset"),
        ] {
            let message = folder.read(&format!("a:b.h5{dataset}")).unwrap_err();
            assert!(message.contains(said), "{dataset}: {message}");
        }
    }

    #[test]
    fn files_that_are_not_hdf5() {
        let folder = Folder::new();
        fs::write(folder.path("x.h5"), b"\x89HDF\r\n\x1a\n and then nothing").unwrap();
        assert!(
            folder
                .read("x.h5:/patterns")
                .unwrap_err()
                .contains("not a readable HDF5 file")
        );
        assert!(folder.read("gone.h5:/patterns").unwrap_err().contains("No such file"));
    }
}
