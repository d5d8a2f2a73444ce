//! A dataset of any HDF5 file, also of this program's own artifacts: `FILE.h5:/dataset`.

use std::collections::BTreeSet;
use std::path::Path;

use hdf5::dataset::Layout;
use hdf5::types::TypeDescriptor;
use hdf5::{Dataset, File, Group, IndexType, IterationOrder, LinkType};

use super::raster::Pattern;
use super::read::{MOST, Refusal, count, patterns};

/// Groups inside each other on the way to a dataset.
const DEEPEST: usize = 100;

/// Bytes of a chunk: the largest stack in one.
const MAX_CHUNK: u64 = MOST * 2500 * 8;

/// `FILE.h5` and `/dataset`; both may hold colons, so the split is after the file's extension.
pub fn split(spec: &str) -> Option<(&str, &str)> {
    let lower = spec.to_ascii_lowercase();
    let after = |extension: &str| lower.rfind(&format!("{extension}:/")).map(|at| at + extension.len());
    let colon = after(".h5").into_iter().chain(after(".hdf5")).max()?;
    Some((&spec[..colon], &spec[colon + 1..]))
}

pub(super) fn read(path: &Path, dataset: &str) -> Result<Vec<Pattern>, Refusal> {
    let file = File::open(path).map_err(|e| Refusal::new(format!("not a readable HDF5 file ({e})")))?;
    let found = open(&file, dataset).map_err(|problem| match problem {
        Problem::Absent => Refusal::new(format!("no dataset {dataset:?} in the file")).help(advice(path)),
        Problem::Refused(what) => {
            Refusal::new(what).help("copy the dataset itself into the file, for example with h5py")
        }
    })?;
    let broken = |e: hdf5::Error| Refusal::new(format!("the dataset cannot be read ({e})"));
    let shape: Vec<u64> = found.shape().iter().map(|&n| n as u64).collect();
    count(&shape)?;
    check_storage(path, &found, true).map_err(Refusal::new)?;
    let element = found.dtype().map_err(broken)?;
    // The size is checked first: the library describes enumerations of wider integers wrongly.
    let described = if element.size() <= 8 {
        element.to_descriptor().ok()
    } else {
        None
    };
    match described {
        Some(
            TypeDescriptor::Integer(_)
            | TypeDescriptor::Unsigned(_)
            | TypeDescriptor::Float(_)
            | TypeDescriptor::Boolean,
        ) => patterns(&found.read_raw::<f64>().map_err(broken)?),
        Some(other) => Err(Refusal::new(format!("elements of type {other}")).help(TYPES)),
        None => Err(Refusal::new(format!("elements of an unknown type of {} bytes", element.size())).help(TYPES)),
    }
}

/// Refuses a dataset of a file whose elements stand in other files: behind links, in external storage, or in sources of a
/// virtual dataset that are missing, for which the library shows zeros. A dataset that is not there is none of these.
///
/// # Errors
/// Why it is refused.
pub fn check_contained(path: &Path, dataset: &str) -> Result<(), String> {
    let file = File::open(path).map_err(|e| format!("not a readable HDF5 file ({e})"))?;
    match open(&file, dataset) {
        Ok(found) => check_storage(path, &found, true).map_err(|why| format!("`{dataset}`: {why}")),
        Err(Problem::Absent) => Ok(()),
        Err(Problem::Refused(why)) => Err(why),
    }
}

/// Why there is no dataset to read.
enum Problem {
    Absent,
    Refused(String),
}

/// Opens a dataset that lies in the file itself. The library would follow a link into any other file, and wait for a pipe
/// there.
fn open(file: &File, dataset: &str) -> Result<Dataset, Problem> {
    let broken = |e: hdf5::Error| Problem::Refused(format!("{dataset:?} cannot be opened ({e})"));
    let mut steps: Vec<&str> = dataset.split('/').filter(|step| !step.is_empty()).collect();
    let last = steps.pop().ok_or(Problem::Absent)?;
    if steps.len() >= DEEPEST {
        return Err(Problem::Refused(format!("{} groups inside each other", steps.len())));
    }
    let mut group = file.as_group().map_err(broken)?;
    for step in steps {
        check_link(&group, step)?;
        group = group.group(step).map_err(|_| Problem::Absent)?;
    }
    check_link(&group, last)?;
    // A group of that name is no dataset; a dataset that needs a filter or a format which is not there is one.
    match group.dataset(last) {
        Err(_) if group.group(last).is_ok() => Err(Problem::Absent),
        opened => opened.map_err(broken),
    }
}

fn check_link(group: &Group, name: &str) -> Result<(), Problem> {
    let found = group.find_link(IndexType::Name, IterationOrder::Native, |other, info| {
        Ok((other == name).then_some(info.link_type))
    });
    match found {
        Ok(Some(LinkType::Hard)) => Ok(()),
        Ok(Some(_)) => Err(Problem::Refused(format!("{name:?} is a link to another place"))),
        Ok(None) => Err(Problem::Absent),
        Err(error) => Err(Problem::Refused(format!("the file cannot be read ({error})"))),
    }
}

/// Refuses elements that stand in files which are not HDF5, and chunks that would not fit into memory. A virtual dataset
/// shows zeros where its sources are missing, so they are looked for; sources are not virtual themselves.
fn check_storage(path: &Path, dataset: &Dataset, may_be_virtual: bool) -> Result<(), String> {
    let broken = |e: hdf5::Error| format!("the dataset cannot be read ({e})");
    let list = dataset.create_plist().map_err(broken)?;
    if !list.get_external().map_err(broken)?.is_empty() {
        return Err("its elements stand in another file".into());
    }
    let size = dataset.dtype().map_err(broken)?.size() as u64;
    let chunk = dataset.chunk().unwrap_or_default();
    if chunk.iter().fold(size, |bytes, &n| bytes.saturating_mul(n as u64)) > MAX_CHUNK {
        return Err(format!("its chunks have more than {MAX_CHUNK} bytes"));
    }
    if dataset.layout() != Layout::Virtual {
        return Ok(());
    }
    if !may_be_virtual {
        return Err("it is a virtual dataset of virtual datasets".into());
    }
    let untold = |e: hdf5::Error| format!("it shows what stands in other files, and its parts cannot be told ({e})");
    let sources = list.get_virtual_map().map_err(untold)?;
    let places: BTreeSet<(String, String)> = sources.into_iter().map(|s| (s.src_filename, s.src_dataset)).collect();
    places
        .iter()
        .try_for_each(|(name, inside)| check_source(path, name, inside))
}

/// One source of a virtual dataset in the file at `path`; "." is that file.
fn check_source(path: &Path, name: &str, inside: &str) -> Result<(), String> {
    let source = match name {
        "." => path.to_owned(),
        _ => path.parent().unwrap_or(Path::new("")).join(name),
    };
    let missing = |why: &str| format!("it shows what stands in {}, which {why}", source.display());
    if !source.is_file() {
        return Err(missing("is not there"));
    }
    let file = File::open(&source).map_err(|e| missing(&format!("is not a readable HDF5 file ({e})")))?;
    let dataset = open(&file, inside).map_err(|_| missing(&format!("has no dataset {inside:?} of its own")))?;
    check_storage(&source, &dataset, false)
}

const TYPES: &str = "allowed: booleans, integers (1 to 8 bytes), floats (4 or 8 bytes)";

/// How to name a dataset, with those at the top of the file.
pub(super) fn advice(path: &Path) -> String {
    let names = File::open(path).and_then(|f| f.member_names()).unwrap_or_default();
    let mut text = "name a dataset, such as FILE.h5:/patterns".to_owned();
    if !names.is_empty() {
        let shown: Vec<String> = names.iter().take(12).map(|n| format!("/{n}")).collect();
        text += &format!("; the file holds {}", shown.join(", "));
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
