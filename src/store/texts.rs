//! Writes texts as attributes, each with its own fixed length.

use hdf5::types::{FixedUnicode, TypeDescriptor};
use hdf5::{Attribute, Group, Location};

use deaflow_hdf::LONG;

/// Maximum length of the text of an attribute, bytes: with name and type it must fit into a message of 64 KiB in the
/// object header (HDF5 File Format Specification 3.0, §IV.A.1).
const LONGEST: usize = 60_000;

/// Writes the attributes of a group. Texts that are too long for attributes become datasets of bytes.
pub fn attributes<'a>(group: &Group, entries: impl Iterator<Item = (&'a str, &'a str)>) -> hdf5::Result<()> {
    let mut long = None;
    for (name, value) in entries {
        if value.len() <= LONGEST {
            attribute(group, name, value)?;
            continue;
        }
        let group = match &long {
            Some(group) => group,
            None => long.insert(group.create_group(LONG)?),
        };
        let bytes = group.new_dataset::<u8>().shape(value.len()).create(name)?;
        bytes.write_raw(value.as_bytes())?;
    }
    Ok(())
}

/// Writes a text of at most 60,000 bytes.
pub fn attribute(location: &Location, name: &str, value: &str) -> hdf5::Result<()> {
    // The library has no texts of length 0.
    let element = TypeDescriptor::FixedUnicode(value.len().max(1));
    let attribute = location.new_attr_builder().empty_as(&element).create(name)?;
    match value.len() {
        0..=64 => write::<64>(&attribute, &[value]),
        65..=1024 => write::<1024>(&attribute, &[value]),
        _ => write::<{ 1 << 16 }>(&attribute, &[value]),
    }
}

/// Writes names as an attribute; nothing if there are none.
pub fn names(location: &Location, name: &str, values: &[String]) -> hdf5::Result<()> {
    let Some(longest) = values.iter().map(String::len).max() else {
        return Ok(());
    };
    let element = TypeDescriptor::FixedUnicode(longest.max(1));
    let attribute = location.new_attr_builder().empty_as(&element).shape(values.len());
    let values: Vec<&str> = values.iter().map(String::as_str).collect();
    write::<1024>(&attribute.create(name)?, &values)
}

/// Writes texts; the library converts them to the length of the attribute.
fn write<const N: usize>(attribute: &Attribute, values: &[&str]) -> hdf5::Result<()> {
    let texts: Result<Vec<FixedUnicode<N>>, _> = values.iter().map(|value| value.parse()).collect();
    let texts =
        texts.map_err(|_| hdf5::Error::from(format!("the text of attribute `{}` is too long", attribute.name())))?;
    attribute.write_raw(&texts)
}
