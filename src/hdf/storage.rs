//! Checks that the elements of a dataset are in its file, as many as it claims, and packed by known filters.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use hdf5::dataset::Layout;
use hdf5::filters::Filter;
use hdf5::types::{FloatSize, IntSize, TypeDescriptor};
use hdf5::{Dataset, File, H5Type, Hyperslab, SliceOrIndex};
use ndarray::IxDyn;

use super::elements::Element;
use super::error::{Failure, system_error};
use super::limits::{CHUNK, PACKED};
use super::links::is_here;

/// Maximum depth of groups above a dataset.
const DEEPEST: usize = 100;

/// Maximum number of sources of a virtual dataset.
const SOURCES: usize = 500_000;

/// Returns a dataset of the file itself, if it exists. Links to other files are refused.
pub(super) fn find(file: &File, dataset: &str) -> Result<Option<Dataset>, Failure> {
    let broken = |e: hdf5::Error| Failure::refused(e, |e| format!("{dataset:?} cannot be opened ({e})"));
    let mut steps: Vec<&str> = dataset.split('/').filter(|step| !step.is_empty()).collect();
    let Some(last) = steps.pop() else { return Ok(None) };
    if steps.len() >= DEEPEST {
        return Err(Failure::Refused(format!("its groups are nested {} deep", steps.len())));
    }
    let mut group = file.as_group().map_err(broken)?;
    for step in steps {
        if !is_here(file, &group, step)? {
            return Ok(None);
        }
        match group.group(step) {
            Ok(inner) => group = inner,
            Err(error) if system_error(&error).is_some() => return Err(error.into()),
            Err(_) => return Ok(None),
        }
    }
    if !is_here(file, &group, last)? {
        return Ok(None);
    }
    // A group is not a dataset. A dataset with a missing plugin is an error.
    match group.dataset(last) {
        Err(_) if group.group(last).is_ok() => Ok(None),
        opened => opened.map(Some).map_err(broken),
    }
}

/// Refuses elements that are in other files, are missing, or cannot be decompressed. The sources of a virtual dataset
/// must exist, because it would show fill values otherwise, and must not be virtual.
pub(super) fn check(path: &Path, dataset: &Dataset) -> Result<(), Failure> {
    let inside = match dataset.layout() {
        Layout::Virtual => sources(path, dataset)?,
        _ => inside(path, dataset)?,
    };
    let bytes = bytes(dataset)?;
    if bytes > inside {
        let why = format!("it claims {bytes} bytes of elements, but the file can contain only {inside}");
        return Err(Failure::Refused(why));
    }
    Ok(())
}

/// Whether all elements are in a file of that length, neither in chunks nor in other files.
pub(super) fn is_inside(dataset: &Dataset, length: u64) -> Result<bool, Failure> {
    let bytes = bytes(dataset)?;
    let plain = matches!(dataset.layout(), Layout::Contiguous | Layout::Compact) && bytes <= length;
    Ok(bytes == 0 || (plain && dataset.create_plist()?.get_external()?.is_empty()))
}

/// Returns the number of bytes of all elements.
pub(super) fn bytes(dataset: &Dataset) -> Result<u64, Failure> {
    let size = dataset.dtype()?.size() as u64;
    let shape = dataset.get_shape()?;
    Ok(shape.iter().fold(size, |bytes, &n| bytes.saturating_mul(n as u64)))
}

/// Returns how many bytes of elements a dataset that is not virtual can contain.
fn inside(path: &Path, dataset: &Dataset) -> Result<u64, Failure> {
    let list = dataset.create_plist()?;
    if !list.get_external()?.is_empty() {
        return Err(Failure::Refused("its elements are in another file".into()));
    }
    let length = std::fs::metadata(path).map_err(|e| Failure::unopened(&e))?.len();
    if dataset.layout() != Layout::Chunked {
        return Ok(length);
    }
    let size = dataset.dtype()?.size() as u64;
    let chunk = dataset.chunk().unwrap_or_default();
    if chunk.iter().fold(size, |bytes, &n| bytes.saturating_mul(n as u64)) > CHUNK {
        let most = CHUNK >> 20;
        return Err(Failure::Refused(format!("its chunks are larger than {most} MiB")));
    }
    if let Some(Filter::User(number, _)) = list.get_filters()?.iter().find(|f| matches!(f, Filter::User(..))) {
        let why = format!(
            "its elements are compressed with {}; allowed: deflate (gzip), shuffle, fletcher32, szip, nbit, \
             scaleoffset",
            filter_name(*number)
        );
        return Err(Failure::Refused(why));
    }
    Ok(dataset.storage_size().min(length).saturating_mul(PACKED))
}

/// Names a filter that is not part of the library, by its registered number.
fn filter_name(number: i32) -> String {
    let name = match number {
        32_000 => "lzf",
        32_001 => "blosc",
        32_004 => "lz4",
        32_008 => "bitshuffle",
        32_013 => "zfp",
        32_015 => "zstd",
        32_026 => "blosc2",
        _ => return format!("filter {number}"),
    };
    format!("{name} (filter {number})")
}

/// Returns how many bytes of elements the sources of a virtual dataset contain.
fn sources(path: &Path, dataset: &Dataset) -> Result<u64, Failure> {
    let unreadable = |e: hdf5::Error| {
        Failure::refused(e, |e| {
            format!("it is a virtual dataset whose sources cannot be read ({e})")
        })
    };
    let map = dataset.create_plist()?.get_virtual_map().map_err(unreadable)?;
    if map.len() > SOURCES {
        return Err(Failure::Refused(format!(
            "it is a virtual dataset with {} sources, more than allowed",
            map.len()
        )));
    }
    let mut known: BTreeMap<(String, String), u64> = BTreeMap::new();
    let mut inside = 0_u64;
    for part in map {
        let place = (part.src_filename, part.src_dataset);
        let bytes = match known.get(&place) {
            Some(bytes) => *bytes,
            None => source(path, &place.0, &place.1)?,
        };
        known.insert(place, bytes);
        inside = inside.saturating_add(bytes);
    }
    Ok(inside)
}

/// Returns the bytes in one source of a virtual dataset in the file at `path`; "." is that file.
fn source(path: &Path, name: &str, dataset: &str) -> Result<u64, Failure> {
    let source: PathBuf = match name {
        "." => path.to_owned(),
        _ => path.parent().unwrap_or(Path::new("")).join(name),
    };
    let missing = |why: &str| Failure::Refused(format!("its source {} {why}", source.display()));
    if !source.is_file() {
        return Err(missing("is missing"));
    }
    let file = File::open(&source).map_err(|e| missing(&format!("is not a readable HDF5 file ({e})")))?;
    let found = find(&file, dataset).ok().flatten();
    let found = found.ok_or_else(|| missing(&format!("has no dataset {dataset:?}")))?;
    if found.layout() == Layout::Virtual {
        return Err(Failure::Refused("it is a virtual dataset with virtual sources".into()));
    }
    check(&source, &found)?;
    bytes(&found)
}

/// Returns the element type. The size is checked first: the library describes enumerations of wide integers wrongly.
pub(super) fn element(dataset: &Dataset) -> Result<Element, Failure> {
    let element = dataset.dtype()?;
    // Half and extended precision, and enumerations: the library converts them, but does not describe them.
    let is_converted = || element.size() <= 16 && element.conv_to::<f64>().is_some();
    let described = match element.to_descriptor() {
        Err(_) if is_converted() => return Ok(Element::Number),
        Err(_) => return Ok(Element::Other(format!("unknown, of {} bytes", element.size()))),
        Ok(described) => described,
    };
    Ok(match described {
        TypeDescriptor::FixedUnicode(width) => Element::Text(width as u64),
        TypeDescriptor::FixedAscii(_) | TypeDescriptor::VarLenUnicode | TypeDescriptor::VarLenAscii => {
            Element::OtherText
        }
        _ if element.size() > 8 => Element::Other(format!("unknown, of {} bytes", element.size())),
        TypeDescriptor::Unsigned(IntSize::U1) => Element::U8,
        TypeDescriptor::Unsigned(IntSize::U4) => Element::U32,
        TypeDescriptor::Unsigned(IntSize::U8) => Element::U64,
        TypeDescriptor::Float(FloatSize::U4) => Element::F32,
        TypeDescriptor::Float(FloatSize::U8) => Element::F64,
        TypeDescriptor::Integer(_) | TypeDescriptor::Unsigned(_) | TypeDescriptor::Boolean => Element::Number,
        TypeDescriptor::Enum(_) if is_converted() => Element::Number,
        other => Element::Other(other.to_string()),
    })
}

/// Reads all elements. An empty array has no storage in the file.
pub(super) fn whole<T: H5Type>(dataset: &Dataset) -> hdf5::Result<Vec<T>> {
    match dataset.size() {
        0 => Ok(Vec::new()),
        _ => dataset.read_raw(),
    }
}

/// Reads rows.
pub(super) fn rows<T: H5Type>(dataset: &Dataset, rows: Range<u64>) -> hdf5::Result<Vec<T>> {
    let shape = dataset.get_shape()?;
    let rows = rows.start as usize..rows.end as usize;
    if shape.is_empty() || rows == (0..shape[0]) {
        return whole(dataset);
    }
    if rows.is_empty() {
        return Ok(Vec::new());
    }
    let slab: Vec<SliceOrIndex> = shape
        .iter()
        .enumerate()
        .map(|(axis, &extent)| if axis == 0 { rows.clone() } else { 0..extent }.into())
        .collect();
    let slice = dataset.read_slice::<T, _, IxDyn>(Hyperslab::new(slab))?;
    // The array is contiguous, so its memory has the elements in order.
    Ok(slice.into_raw_vec_and_offset().0)
}

/// Reads a range of the last axis, the slowest of the array in MATLAB, in the order of MATLAB's axes.
pub(super) fn last_rows(dataset: &Dataset, rows: Range<u64>) -> hdf5::Result<Vec<f64>> {
    let shape = dataset.get_shape()?;
    if rows.is_empty() || shape.contains(&0) {
        return Ok(Vec::new());
    }
    let rows = rows.start as usize..rows.end as usize;
    let last = shape.len().saturating_sub(1);
    let slab: Vec<SliceOrIndex> = shape
        .iter()
        .enumerate()
        .map(|(axis, &extent)| if axis == last { rows.clone() } else { 0..extent }.into())
        .collect();
    let slice = dataset.read_slice::<f64, _, IxDyn>(Hyperslab::new(slab))?;
    Ok(slice.reversed_axes().iter().copied().collect())
}
