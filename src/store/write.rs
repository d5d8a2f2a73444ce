//! Writes an artifact as an HDF5 file that any HDF5 tool can read without this program.
//!
//! The file of a manifest shows its chunks as whole arrays by virtual datasets (HDF5 ≥ 1.10). Their sources are
//! relative to the folder of the file, so that a store can be moved.
//!
//! This program reads nothing from the global heap of a file, where libhdf5 handles damaged data badly: texts have
//! fixed lengths, and axes are named by texts, not by references. Only the parts of virtual datasets are in the heap,
//! and it never opens those.

use std::path::Path;
use std::sync::Arc;

use hdf5::types::FixedUnicode;
use hdf5::{Extents, Group, H5Type, Hyperslab, SliceOrIndex};
use ndarray::{ArrayView, IxDyn};

use super::element_type::ElementType;
use super::header::BLOCK;
use super::listing::{Content, Listing};
use super::object::{Data, Dataset, KIND, Object, TEXT_WIDTH};
use super::provenance::Provenance;
use super::{create, scales, texts};
use deaflow_base::ArtifactId;
use deaflow_hdf::AXES;

/// One element of a text dataset.
pub type TextCell = FixedUnicode<TEXT_WIDTH>;

/// Bytes of an array that are copied at a time.
pub(super) const PIECE: usize = 8 << 20;

/// A chunk of a manifest.
pub struct Part {
    /// The chunk.
    pub digest: ArtifactId,
    /// Its datasets.
    pub listing: Arc<Listing>,
}

/// Writes an object with an empty user block. `parts` are the chunks of a manifest; `contents` describes the datasets
/// of the object, or the concatenated datasets of the chunks.
///
/// # Errors
/// If the library reports an error, for instance a full disk.
pub fn write(
    path: &Path,
    object: &Object,
    parts: &[Part],
    contents: &[Content],
    provenance: &Provenance,
) -> hdf5::Result<()> {
    let file = create::new_file()
        .with_fcpl(|plist| plist.userblock(BLOCK as u64))
        .create(path)?;
    let attributes = object
        .attributes
        .iter()
        .map(|(name, value)| (name.as_str(), value.as_str()));
    let kind = Some((KIND, object.kind.as_str())).filter(|(_, kind)| !kind.is_empty());
    texts::attributes(&file, attributes.chain(kind))?;
    // Small arrays are buffered in their dataset. Closing it writes them but ignores errors, so a full disk would leave
    // zeros. All datasets stay open until the file has been flushed.
    let mut open = Vec::with_capacity(object.datasets.len());
    for (name, dataset) in &object.datasets {
        open.push(write_dataset(&file, name, dataset)?);
    }
    if !object.parts.is_empty() {
        open.push(write_dataset(&file, "parts", &digests(&object.parts))?);
        for content in contents {
            write_virtual(&file, content, parts)?;
        }
    }
    scales::attach(&file, path.parent().unwrap_or(Path::new(".")), contents)?;
    let group = file.create_group("provenance")?;
    let entries = provenance.entries();
    texts::attributes(&group, entries.iter().map(|(name, value)| (*name, value.as_str())))?;
    drop(group);
    // The library reports a full disk when flushing, but not when closing.
    file.flush()?;
    drop(open);
    file.close()
}

fn digests(parts: &[ArtifactId]) -> Dataset {
    let texts: Vec<String> = parts.iter().map(ArtifactId::to_string).collect();
    let description = "Digests of the chunks, in order";
    Dataset::new("", description, &[texts.len()], Data::Text(texts))
}

pub(super) fn describe(dataset: &hdf5::Dataset, units: &str, description: &str, axes: &[String]) -> hdf5::Result<()> {
    texts::attribute(dataset, "units", units)?;
    texts::attribute(dataset, "description", description)?;
    texts::names(dataset, AXES, axes)
}

pub(super) fn write_dataset(group: &Group, name: &str, dataset: &Dataset) -> hdf5::Result<hdf5::Dataset> {
    match &dataset.data {
        Data::U8(v) => write_elements(group, name, dataset, v),
        Data::U32(v) => write_elements(group, name, dataset, v),
        Data::U64(v) => write_elements(group, name, dataset, v),
        // −0 and 0 have the same digest, so the file must always have the same one.
        Data::F32(v) => write_floats(group, name, dataset, v, |x| x + 0.0),
        Data::F64(v) => write_floats(group, name, dataset, v, |x| x + 0.0),
        Data::Text(v) => {
            let cells: Result<Vec<TextCell>, _> = v.iter().map(|text| text.parse()).collect();
            let cells = cells.map_err(|_| hdf5::Error::from(format!("dataset `{name}`: a text is too long")))?;
            write_elements(group, name, dataset, &cells)
        }
    }
}

fn write_elements<T: H5Type>(
    group: &Group,
    name: &str,
    dataset: &Dataset,
    elements: &[T],
) -> hdf5::Result<hdf5::Dataset> {
    let written = group.new_dataset::<T>().shape(dataset.shape.clone()).create(name)?;
    if !elements.is_empty() {
        written.write_raw(elements)?;
    }
    describe(&written, &dataset.units, &dataset.description, &dataset.axes)?;
    Ok(written)
}

/// Writes the numbers that a function returns, some rows at a time, to avoid a second copy of large arrays.
fn write_floats<T: H5Type + Copy>(
    group: &Group,
    name: &str,
    dataset: &Dataset,
    elements: &[T],
    convert: impl Fn(T) -> T,
) -> hdf5::Result<hdf5::Dataset> {
    let shape = &dataset.shape;
    let written = group.new_dataset::<T>().shape(shape.clone()).create(name)?;
    let row: usize = shape.iter().skip(1).product();
    let rows = (PIECE / (row * size_of::<T>()).max(1)).max(1);
    for (piece, values) in elements.chunks((rows * row).max(1)).enumerate() {
        let values: Vec<T> = values.iter().map(|value| convert(*value)).collect();
        put_elements(&written, shape, piece * rows, values.len() / row, &values)?;
    }
    describe(&written, &dataset.units, &dataset.description, &dataset.axes)?;
    Ok(written)
}

/// Writes `count` rows of a dataset of the given shape, starting at row `start`.
pub(super) fn put_elements<T: H5Type>(
    dataset: &hdf5::Dataset,
    shape: &[usize],
    start: usize,
    count: usize,
    elements: &[T],
) -> hdf5::Result<()> {
    if elements.is_empty() {
        return Ok(());
    }
    if shape.is_empty() {
        return dataset.write_raw(elements);
    }
    let mut extents = shape.to_vec();
    extents[0] = count;
    let view = ArrayView::from_shape(IxDyn(&extents), elements).map_err(|e| hdf5::Error::from(e.to_string()))?;
    let rows: Hyperslab = slab(start, &extents);
    dataset.write_slice(view, rows)
}

/// Writes a virtual dataset. If its chunks are missing, it shows a fill value that no artifact contains, instead of
/// zeros.
fn write_virtual(group: &Group, content: &Content, parts: &[Part]) -> hdf5::Result<()> {
    match content.kind {
        ElementType::U8 => write_virtual_of(group, content, parts, u8::MAX),
        ElementType::U32 => write_virtual_of(group, content, parts, u32::MAX),
        ElementType::U64 => write_virtual_of(group, content, parts, u64::MAX),
        ElementType::F32 => write_virtual_of(group, content, parts, f32::NAN),
        ElementType::F64 => write_virtual_of(group, content, parts, f64::NAN),
        ElementType::Text => {
            let lost: Result<TextCell, _> = "(the chunk is missing)".parse();
            let lost = lost.map_err(|_| hdf5::Error::from("the text is too long"))?;
            write_virtual_of(group, content, parts, lost)
        }
    }
}

fn write_virtual_of<T: H5Type>(group: &Group, whole: &Content, parts: &[Part], lost: T) -> hdf5::Result<()> {
    let slabs: Vec<(&ArtifactId, &[usize])> = parts
        .iter()
        .flat_map(|part| {
            let same = part.listing.contents.iter().find(|content| content.path == whole.path);
            same.map(|content| (&part.digest, content.shape.as_slice()))
        })
        .collect();
    let mut builder = group.new_dataset::<T>().shape(whole.shape.clone()).fill_value(lost);
    let mut start = 0;
    for (digest, shape) in slabs {
        // The library does not accept empty selections.
        if shape.iter().product::<usize>() > 0 {
            builder = builder.virtual_map(
                source(digest),
                &whole.path,
                Extents::from(shape.to_vec()),
                slab(0, shape),
                Extents::from(whole.shape.clone()),
                slab(start, shape),
            );
        }
        start += shape[0];
    }
    let written = builder.create(whole.path.as_str())?;
    describe(&written, &whole.units, &whole.description, &whole.axes)
}

/// Returns the path of the file of a chunk, relative to the folder of any artifact.
fn source(digest: &ArtifactId) -> String {
    let name = digest.to_string();
    format!("../{}/{name}.h5", &name[..2])
}

pub(super) fn slab(start: usize, shape: &[usize]) -> Hyperslab {
    let mut ranges: Vec<SliceOrIndex> = shape.iter().map(|&n| SliceOrIndex::from(0..n)).collect();
    ranges[0] = SliceOrIndex::from(start..start + shape[0]);
    Hyperslab::from(ranges)
}
