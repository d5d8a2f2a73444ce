//! Texts of attributes.
//!
//! This program writes them at a fixed length: a text of variable length stands in the global heap of a file, on which
//! libhdf5 is easily led astray. Readers of files of others, and of earlier files of ours, take both.

use std::collections::BTreeMap;

use hdf5::types::{FixedAscii, FixedUnicode, TypeDescriptor, VarLenAscii, VarLenUnicode};
use hdf5::{Attribute, Group, Location};

use super::error::Failure;
use super::storage;

/// The attribute of a dataset that names its axes, one text for each.
pub const AXES: &str = "axes";

/// The same in files of earlier builds, at a variable length.
const LABELS: &str = "DIMENSION_LABELS";

/// The group of texts that are too long for attributes, each a dataset of bytes.
pub const LONG: &str = "long_attributes";

/// More than the longest attribute, bytes: a message in the header of an object has at most 64 KiB.
const LONGEST: usize = 1 << 16;

/// All attributes of a group in a file of that length, which must be texts; the long ones are among them.
pub(super) fn all(group: &Group, length: u64) -> Result<BTreeMap<String, String>, Failure> {
    let mut out = BTreeMap::new();
    for name in group.attr_names()? {
        let value = one(group, &name)?;
        out.insert(name, value);
    }
    if group.link_exists(LONG) {
        let long = group.group(LONG)?;
        for name in long.member_names()? {
            let dataset = long.dataset(&name)?;
            if !storage::is_inside(&dataset, length)? {
                return Err(Failure::Refused(format!("the attribute `{name}` is not in the file")));
            }
            out.insert(name.clone(), utf8(storage::whole(&dataset)?, &name)?);
        }
    }
    Ok(out)
}

/// One text.
pub(super) fn one(location: &Location, name: &str) -> hdf5::Result<String> {
    let attribute = location.attr(name)?;
    let bytes = match attribute.dtype()?.to_descriptor()? {
        TypeDescriptor::VarLenUnicode => attribute.read_scalar::<VarLenUnicode>()?.as_bytes().to_vec(),
        TypeDescriptor::VarLenAscii => attribute.read_scalar::<VarLenAscii>()?.as_bytes().to_vec(),
        TypeDescriptor::FixedUnicode(n) if n <= LONGEST => {
            attribute.read_scalar::<FixedUnicode<LONGEST>>()?.as_bytes().to_vec()
        }
        TypeDescriptor::FixedAscii(n) if n <= LONGEST => {
            attribute.read_scalar::<FixedAscii<LONGEST>>()?.as_bytes().to_vec()
        }
        other => return Err(format!("the attribute `{name}` is {other}, not a text").into()),
    };
    utf8(bytes, name)
}

/// The names of the axes of a dataset with so many; none where they have none.
pub(super) fn axes(dataset: &hdf5::Dataset, names: &[String], count: usize) -> hdf5::Result<Vec<String>> {
    let has = |name: &str| names.iter().any(|other| other == name);
    let found = match (has(AXES), has(LABELS)) {
        (true, _) => fixed(&dataset.attr(AXES)?)?,
        (false, true) => variable(&dataset.attr(LABELS)?)?,
        (false, false) => return Ok(Vec::new()),
    };
    match found.len() == count {
        true => Ok(found),
        false => Err(format!("{} names for {count} axes", found.len()).into()),
    }
}

/// Names have at most 64 bytes, and there are at most 32 axes.
fn fixed(attribute: &Attribute) -> hdf5::Result<Vec<String>> {
    let element = attribute.dtype()?.to_descriptor()?;
    if attribute.size() > 32 || !matches!(element, TypeDescriptor::FixedUnicode(n) if n <= 1024) {
        return Err(format!("`{AXES}` does not hold names of axes").into());
    }
    let names: Vec<FixedUnicode<1024>> = attribute.read_raw()?;
    names.iter().map(|name| utf8(name.as_bytes().to_vec(), AXES)).collect()
}

fn variable(attribute: &Attribute) -> hdf5::Result<Vec<String>> {
    if attribute.size() > 32 {
        return Err(format!("`{LABELS}` does not hold names of axes").into());
    }
    let names: Vec<VarLenUnicode> = attribute.read_raw()?;
    names
        .iter()
        .map(|name| utf8(name.as_bytes().to_vec(), LABELS))
        .collect()
}

/// The library's own conversion takes the bytes on trust.
pub(super) fn utf8(bytes: Vec<u8>, name: &str) -> hdf5::Result<String> {
    String::from_utf8(bytes).map_err(|_| format!("`{name}` is not UTF-8").into())
}
