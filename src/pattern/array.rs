//! Reads patterns from arrays: NumPy, HDF5, netCDF-4 and MATLAB 7.3.

use std::path::Path;

use super::file::{Cells, FilePatterns, PatternFileError, count};
use super::raster::PatternForm;
use deaflow_array::{Array, ArrayError, ArrayFile, Format};
use deaflow_base::listed;

/// Arrays beside those of patterns with edges within cells, and notes on them.
const WITHIN_CELLS: [(&str, &str); 2] = [
    (
        "electrodes/polygons",
        "the electrodes were drawn with fitted edges; here they are the cells whose centre was in a shape",
    ),
    (
        "covered/share",
        "the electrodes cover parts of cells; here they are the cells that are covered by half or more",
    ),
];

/// Cells read at a time: 8 MB of numbers.
const SLICE: usize = 1_000_000;

/// Reads the patterns of an array; without a name, of the only one with the shape of patterns.
pub(super) fn read(
    path: &Path,
    format: Format,
    dataset: Option<&str>,
    form: PatternForm,
) -> Result<FilePatterns, PatternFileError> {
    let fits = |shape: &[u64]| count(shape, form).is_ok();
    let file = ArrayFile::open(path, format)?;
    let array = find(&file, format, dataset, fits)?;
    let n = count(array.shape(), form)?;
    array.check()?;
    let mut cells = Cells::new(form, n);
    if array.shape().len() == 2 {
        cells.add(&array.rows(0..form.raster.rows())?)?;
    } else {
        let step = (SLICE / form.raster.cells()).max(1);
        for first in (0..n).step_by(step) {
            cells.add(&array.rows(first..n.min(first + step))?)?;
        }
    }
    let mut read = cells.finish()?;
    read.notes.extend(array.notes());
    let group = dataset
        .and_then(|name| name.rsplit_once('/'))
        .map_or("", |(group, _)| group);
    for (name, note) in WITHIN_CELLS.into_iter().filter(|_| format.has_names()) {
        if file.find(&format!("{group}/{name}"))?.is_some() {
            read.notes.push(note.to_owned());
        }
    }
    Ok(read)
}

/// Returns the numbers of columns and rows of an array of patterns.
pub(super) fn sides(path: &Path, format: Format, dataset: Option<&str>) -> Result<[usize; 2], PatternFileError> {
    let file = ArrayFile::open(path, format)?;
    let array = find(&file, format, dataset, |shape| matches!(shape.len(), 2 | 3))?;
    let side = |length: u64| usize::try_from(length).unwrap_or(usize::MAX);
    match *array.shape() {
        [rows, columns] | [_, rows, columns] => Ok([side(columns), side(rows)]),
        _ => Err(
            PatternFileError::new(format!("the array has {} axes", array.shape().len()))
                .help("allowed: (rows, columns) or (n, rows, columns)"),
        ),
    }
}

fn find(
    file: &ArrayFile,
    format: Format,
    dataset: Option<&str>,
    fits: impl Fn(&[u64]) -> bool,
) -> Result<Array, PatternFileError> {
    let Some(name) = dataset else {
        if !format.has_names() {
            let only = file.find("")?;
            return only.ok_or_else(|| PatternFileError::new("the file has no array"));
        }
        let names = match file.only(fits)? {
            Ok(array) => return Ok(array),
            Err(names) => names,
        };
        let why = "not exactly one array of the file has the shape of patterns";
        return Err(PatternFileError::new(why).help(advice(&names)));
    };
    let missing = || -> Result<PatternFileError, ArrayError> {
        let why = format!("the file has no dataset {name:?}");
        Ok(PatternFileError::new(why).help(advice(&file.names()?)))
    };
    match file.find(name)? {
        Some(array) => Ok(array),
        None => Err(missing()?),
    }
}

/// Returns how to name a dataset, with those of the file.
fn advice(names: &[String]) -> String {
    let paths: Vec<String> = names.iter().map(|name| format!("/{name}")).collect();
    format!(
        "name a dataset, such as FILE.h5:/patterns; the file contains {}",
        listed(&paths)
    )
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
    fn the_only_array_with_the_shape_of_patterns_needs_no_name() {
        let folder = Folder::new();
        for name in ["one.nc", "one.mat", "one.hdf5"] {
            h5(&folder.path(name), |file| {
                let pattern = file.new_dataset::<u8>().shape([50, 50]).create("p").unwrap();
                pattern.write_raw(wanted().cells()).unwrap();
                file.new_dataset::<f64>().shape([50]).create("x").unwrap();
                file.new_dataset::<f64>().shape([51, 51, 2]).create("field").unwrap();
            });
            assert_eq!(folder.read(name).unwrap(), [wanted()], "{name}");
            assert_eq!(folder.read(&format!("{name}:/p")).unwrap(), [wanted()], "{name}");
        }
    }

    #[test]
    fn files_that_are_not_hdf5() {
        let folder = Folder::new();
        for (name, bytes, said) in [
            (
                "x.h5",
                &b"\x89HDF\r\n\x1a\n and then nothing"[..],
                "not a readable HDF5 file",
            ),
            ("old.mat", b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "'-v7.3'"),
            ("classic.nc", b"CDF\x01\0\0\0\0", "nccopy"),
        ] {
            fs::write(folder.path(name), bytes).unwrap();
            let message = folder.read(&format!("{name}:/patterns")).unwrap_err();
            assert!(message.contains(said), "{message}");
        }
        assert!(folder.read("gone.h5:/patterns").unwrap_err().contains("No such file"));
    }
}
