//! Where the elements of a dataset stand: in its own file, as many as it says, packed by nothing unknown.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use hdf5::dataset::Layout;
use hdf5::filters::Filter;
use hdf5::types::{FloatSize, IntSize, TypeDescriptor};
use hdf5::{Dataset, File, Group, H5Type, Hyperslab, IndexType, IterationOrder, LinkType, SliceOrIndex};
use ndarray::IxDyn;

use super::elements::Element;
use super::error::Failure;
use super::limits::{CHUNK, PACKED};

/// Groups inside each other on the way to a dataset.
const DEEPEST: usize = 100;

/// Sources of a virtual dataset.
const SOURCES: usize = 500_000;

/// A dataset that lies in the file itself; none where there is none. The library would follow a link into any other file, and wait
/// for a pipe there.
pub(super) fn find(file: &File, dataset: &str) -> Result<Option<Dataset>, Failure> {
    let broken = |e: hdf5::Error| Failure::Refused(format!("cannot open {dataset:?} ({e})"));
    let mut steps: Vec<&str> = dataset.split('/').filter(|step| !step.is_empty()).collect();
    let Some(last) = steps.pop() else { return Ok(None) };
    if steps.len() >= DEEPEST {
        return Err(Failure::Refused(format!("groups are nested {} deep", steps.len())));
    }
    let mut group = file.as_group().map_err(broken)?;
    for step in steps {
        if !is_here(&group, step)? {
            return Ok(None);
        }
        match group.group(step) {
            Ok(inner) => group = inner,
            Err(_) => return Ok(None),
        }
    }
    if !is_here(&group, last)? {
        return Ok(None);
    }
    // A group of that name is no dataset; a dataset that needs a format which is not there is one.
    match group.dataset(last) {
        Err(_) if group.group(last).is_ok() => Ok(None),
        opened => opened.map(Some).map_err(broken),
    }
}

/// Whether something of that name lies in a group.
fn is_here(group: &Group, name: &str) -> Result<bool, Failure> {
    let found = group.find_link(IndexType::Name, IterationOrder::Native, |other, info| {
        Ok((other == name).then_some(info.link_type))
    });
    match found? {
        Some(LinkType::Hard) => Ok(true),
        Some(_) => Err(Failure::Refused(format!("{name:?} is a soft or external link"))),
        None => Ok(false),
    }
}

/// Refuses elements that stand in files which are not HDF5, that are not in the file, or that cannot be unpacked here. A virtual
/// dataset shows fill values where its sources are missing, so they are looked for; sources are not virtual themselves.
pub(super) fn check(path: &Path, dataset: &Dataset) -> Result<(), Failure> {
    let inside = match dataset.layout() {
        Layout::Virtual => sources(path, dataset)?,
        _ => inside(path, dataset)?,
    };
    let bytes = bytes(dataset)?;
    if bytes > inside {
        let why = format!("it declares {bytes} bytes of elements; the file has space for {inside}");
        return Err(Failure::Refused(why));
    }
    Ok(())
}

/// Whether all elements stand in a file of that length as they are: neither in chunks nor elsewhere.
pub(super) fn is_inside(dataset: &Dataset, length: u64) -> Result<bool, Failure> {
    let bytes = bytes(dataset)?;
    let plain = matches!(dataset.layout(), Layout::Contiguous | Layout::Compact) && bytes <= length;
    Ok(bytes == 0 || (plain && dataset.create_plist()?.get_external()?.is_empty()))
}

/// The bytes of all elements, as far as they can be counted.
pub(super) fn bytes(dataset: &Dataset) -> Result<u64, Failure> {
    let size = dataset.dtype()?.size() as u64;
    let shape = dataset.get_shape()?;
    Ok(shape.iter().fold(size, |bytes, &n| bytes.saturating_mul(n as u64)))
}

/// How many bytes of elements a dataset that is not virtual can hold.
fn inside(path: &Path, dataset: &Dataset) -> Result<u64, Failure> {
    let list = dataset.create_plist()?;
    if !list.get_external()?.is_empty() {
        return Err(Failure::Refused("its elements stand in another file".into()));
    }
    let length = std::fs::metadata(path)
        .map_err(|e| Failure::Refused(e.to_string()))?
        .len();
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
            "its elements are packed by filter {number}; allowed: deflate, shuffle, fletcher32, szip, nbit, scaleoffset"
        );
        return Err(Failure::Refused(why));
    }
    Ok(dataset.storage_size().min(length).saturating_mul(PACKED))
}

/// How many bytes of elements the sources of a virtual dataset hold.
fn sources(path: &Path, dataset: &Dataset) -> Result<u64, Failure> {
    let untold = |e: hdf5::Error| {
        Failure::Refused(format!(
            "it shows what stands in other files, and its parts cannot be told ({e})"
        ))
    };
    let map = dataset.create_plist()?.get_virtual_map().map_err(untold)?;
    if map.len() > SOURCES {
        return Err(Failure::Refused(format!("it has {} parts, too many", map.len())));
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

/// The bytes in one source of a virtual dataset in the file at `path`; "." is that file.
fn source(path: &Path, name: &str, dataset: &str) -> Result<u64, Failure> {
    let source: PathBuf = match name {
        "." => path.to_owned(),
        _ => path.parent().unwrap_or(Path::new("")).join(name),
    };
    let missing = |why: &str| Failure::Refused(format!("it refers to {}, which {why}", source.display()));
    if !source.is_file() {
        return Err(missing("is missing"));
    }
    let file = File::open(&source).map_err(|e| missing(&format!("is not a readable HDF5 file ({e})")))?;
    let found = find(&file, dataset).ok().flatten();
    let found = found.ok_or_else(|| missing(&format!("has no stored dataset {dataset:?}")))?;
    if found.layout() == Layout::Virtual {
        return Err(Failure::Refused("it is a virtual dataset of virtual datasets".into()));
    }
    check(&source, &found)?;
    bytes(&found)
}

/// What the elements of a dataset are. The size is looked at first: the library describes enumerations of wider integers wrongly.
pub(super) fn element(dataset: &Dataset) -> Result<Element, Failure> {
    let element = dataset.dtype()?;
    let described = match element.to_descriptor() {
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
        other => Element::Other(other.to_string()),
    })
}

/// All elements. An array without any has no place in a file, and nothing is read.
pub(super) fn whole<T: H5Type>(dataset: &Dataset) -> hdf5::Result<Vec<T>> {
    match dataset.size() {
        0 => Ok(Vec::new()),
        _ => dataset.read_raw(),
    }
}

/// Some rows.
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
    // Read into a fresh array, row by row: its memory is the answer.
    Ok(slice.into_raw_vec_and_offset().0)
}
