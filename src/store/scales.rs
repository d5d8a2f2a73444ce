//! Names of axes for other programs: HDF5 dimension scales (HDF Group, *HDF5 Dimension Scale Specification and Design
//! Notes*), named and numbered as in netCDF-4 for dimensions without coordinates, so that xarray shows `displacement
//! (sample, corner_y, …)`. Arrays refer to scales by number, as in netCDF-4 for variables with several axes, not by
//! references, which would be in the global heap.
//!
//! A scale is a dataset without elements. It is not part of the digest, and this program reads the names from the
//! attribute `axes`.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::OnceLock;

use hdf5::types::FixedAscii;
use hdf5::{Extent, File, SimpleExtents};

use super::create::new_file;
use super::listing::Content;

/// The attribute that makes a dataset a scale.
const CLASS: &str = "CLASS";

/// Its value. Readers expect 16 bytes that end with a zero.
const SCALE: &str = "DIMENSION_SCALE";

/// The attribute of a scale that holds its number.
const NUMBER: &str = "_Netcdf4Dimid";

/// The attribute of an array that holds the numbers of the scales of its axes.
const AXES: &str = "_Netcdf4Coordinates";

/// The longest axis.
const LONGEST: usize = 1 << 62;

/// A datatype message for text of 16 ASCII bytes, filled with zeros (HDF5 File Format Specification 3.0, §IV.A.2.d):
/// class and version, how the text is filled, and the length.
const FILLED: [u8; 8] = [0x13, 1, 0, 0, 16, 0, 0, 0];

/// The same for text that ends with a zero.
const ENDED: [u8; 8] = [0x13, 0, 0, 0, 16, 0, 0, 0];

/// Adds a scale for each named axis of the arrays in a file.
///
/// # Errors
/// If the library reports an error.
pub fn attach(file: &File, folder: &Path, arrays: &[Content]) -> hdf5::Result<()> {
    let Some(template) = template(folder) else {
        return Ok(());
    };
    let mut numbers = BTreeMap::new();
    for (axis, length) in lengths(arrays) {
        // There may be an array of this name.
        let free = [axis.to_owned(), format!("{axis}_axis")];
        let Some(name) = free.into_iter().find(|name| !file.link_exists(name)) else {
            continue;
        };
        template.dataset(SCALE)?.copy_to(file, &name)?;
        let scale = file.dataset(&name)?;
        scale.resize(length)?;
        let described = format!("This is a netCDF dimension but not a netCDF variable.{length:10}");
        let described = FixedAscii::<64>::from_ascii(&described).map_err(|e| hdf5::Error::from(e.to_string()))?;
        scale
            .new_attr::<FixedAscii<64>>()
            .create("NAME")?
            .write_scalar(&described)?;
        let number = numbers.len() as i32;
        scale.new_attr::<i32>().create(NUMBER)?.write_scalar(&number)?;
        numbers.insert(axis, number);
    }
    for array in arrays.iter().filter(|array| !array.axes.is_empty()) {
        let known: Option<Vec<i32>> = array
            .axes
            .iter()
            .map(|axis| numbers.get(axis.as_str()).copied())
            .collect();
        let Some(known) = known else { continue };
        let attribute = file.dataset(&array.path)?.new_attr::<i32>();
        attribute.shape(known.len()).create(AXES)?.write_raw(&known)?;
    }
    Ok(())
}

/// Returns the length of each axis that has the same length in all arrays.
fn lengths(arrays: &[Content]) -> BTreeMap<&str, usize> {
    let mut found: BTreeMap<&str, Option<usize>> = BTreeMap::new();
    for array in arrays.iter().filter(|array| array.axes.len() == array.shape.len()) {
        for (axis, &length) in array.axes.iter().zip(&array.shape) {
            let known = found.entry(axis).or_insert(Some(length));
            *known = known.filter(|known| *known == length);
        }
    }
    found
        .into_iter()
        .filter_map(|(axis, length)| Some((axis, length?)))
        .collect()
}

/// Returns an open file with a scale to copy, which is made once per process in a writable folder.
fn template(folder: &Path) -> Option<&'static File> {
    static TEMPLATE: OnceLock<File> = OnceLock::new();
    if let Some(template) = TEMPLATE.get() {
        return Some(template);
    }
    let made = make_template(folder)?;
    Some(TEMPLATE.get_or_init(|| made))
}

/// The bindings write text of fixed length padded with zeros, but readers accept a scale only if the text is terminated
/// by a zero. So its type is changed in the file; the earliest format version has no checksum of it.
fn make_template(folder: &Path) -> Option<File> {
    let temporary = tempfile::NamedTempFile::new_in(folder).ok()?;
    let mut builder = new_file();
    let file = builder
        .with_fapl(|access| access.libver_earliest())
        .create(temporary.path())
        .ok()?;
    let extents = SimpleExtents::new([Extent::new(0, Some(LONGEST))]);
    let scale = file
        .new_dataset::<f32>()
        .chunk(1024)
        .shape(extents)
        .create(SCALE)
        .ok()?;
    let text = FixedAscii::<16>::from_ascii(SCALE).ok()?;
    scale
        .new_attr::<FixedAscii<16>>()
        .create(CLASS)
        .ok()?
        .write_scalar(&text)
        .ok()?;
    drop(scale);
    file.close().ok()?;
    let mut bytes = std::fs::read(temporary.path()).ok()?;
    let places: Vec<usize> = bytes
        .windows(FILLED.len())
        .enumerate()
        .filter(|(_, w)| **w == FILLED)
        .map(|(at, _)| at)
        .collect();
    let [at] = places[..] else { return None };
    bytes[at..][..ENDED.len()].copy_from_slice(&ENDED);
    std::fs::write(temporary.path(), bytes).ok()?;
    // The file stays open after its name has been removed.
    File::open(temporary.path()).ok()
}
