//! Reads artifact files whose header has been verified.
//!
//! Virtual datasets are for others: a manifest is read by the digests of its chunks, each of them verified.

use std::collections::BTreeMap;
use std::path::Path;

use hdf5::dataset::Layout;
use hdf5::types::{FloatSize, IntSize, TypeDescriptor, VarLenUnicode};
use hdf5::{File, Group, LinkType};

use super::element_type::ElementType;
use super::error::StoreError;
use super::listing::{Content, Listing};
use super::object::{Data, Dataset, KIND, TEXT_WIDTH};
use super::scales;
use super::write::{AXES, TextCell};
use crate::base::ArtifactId;

/// Groups inside each other.
const DEEPEST: u32 = 16;

/// What a file says about itself, without the elements of its datasets.
pub struct Overview {
    /// Content attributes.
    pub attributes: BTreeMap<String, String>,
    /// Digests of the chunks of a manifest.
    pub parts: Vec<ArtifactId>,
    /// Kind and datasets.
    pub listing: Listing,
}

/// Reads all but the elements.
///
/// # Errors
/// When the file is not as this program writes it.
pub fn overview(path: &Path) -> Result<Overview, StoreError> {
    let file = open(path)?;
    let failed = StoreError::hdf5("read", path);
    check(path, &file)?;
    let mut attributes = attributes(&file).map_err(&failed)?;
    let kind = attributes.remove(KIND).unwrap_or_default();
    let names = file.member_names().map_err(&failed)?;
    if names.iter().any(|name| name == "parts") {
        let parts = texts(&file.dataset("parts").map_err(&failed)?).map_err(&failed)?;
        let parts: Result<Vec<ArtifactId>, _> = parts.iter().map(|text| text.parse()).collect();
        return Ok(Overview {
            attributes,
            parts: parts.map_err(|error| StoreError::damaged(path, error.to_string()))?,
            listing: Listing {
                kind,
                contents: Vec::new(),
            },
        });
    }
    let mut contents = Vec::new();
    list(&file, "", &mut contents).map_err(&failed)?;
    contents.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(Overview {
        attributes,
        parts: Vec::new(),
        listing: Listing { kind, contents },
    })
}

/// Reads one dataset.
///
/// # Errors
/// When the file is not as this program writes it.
pub fn dataset(path: &Path, content: &Content) -> Result<Dataset, StoreError> {
    let file = open(path)?;
    let read = || -> hdf5::Result<Dataset> {
        let found = file.dataset(&content.path)?;
        let data = match content.kind {
            ElementType::U8 => Data::U8(found.read_raw()?),
            ElementType::U32 => Data::U32(found.read_raw()?),
            ElementType::U64 => Data::U64(found.read_raw()?),
            ElementType::F32 => Data::F32(found.read_raw()?),
            ElementType::F64 => Data::F64(found.read_raw()?),
            ElementType::Text => Data::Text(texts(&found)?),
        };
        Ok(Dataset {
            units: content.units.clone(),
            description: content.description.clone(),
            axes: content.axes.clone(),
            shape: content.shape.clone(),
            data,
        })
    };
    read().map_err(StoreError::hdf5("read", path))
}

/// Reads the attributes of `/provenance`.
///
/// # Errors
/// When the file is not as this program writes it.
pub fn provenance(path: &Path) -> Result<BTreeMap<String, String>, StoreError> {
    let file = open(path)?;
    file.group("provenance")
        .and_then(|group| attributes(&group))
        .map_err(StoreError::hdf5("read", path))
}

fn open(path: &Path) -> Result<File, StoreError> {
    File::open(path).map_err(StoreError::hdf5("open", path))
}

/// Refuses what this program never writes and what could hold a reader up: links to elsewhere, groups without end, and
/// elements that are not in the file. The header does not say who wrote it.
fn check(path: &Path, file: &File) -> Result<(), StoreError> {
    let length = std::fs::metadata(path).map_err(StoreError::io("read", path))?.len();
    let refused = match check_group(file, length, 0, file.link_exists("parts")) {
        Ok(found) => found,
        Err(error) => return Err(StoreError::hdf5("read", path)(error)),
    };
    refused.map_or(Ok(()), |reason| Err(StoreError::damaged(path, reason)))
}

/// Why a group is refused, if it is.
fn check_group(group: &Group, length: u64, depth: u32, manifest: bool) -> hdf5::Result<Option<String>> {
    if depth > DEEPEST {
        return Ok(Some(format!("its groups are nested more than {DEEPEST} deep")));
    }
    let mut names = Vec::new();
    let mut elsewhere = None;
    group.iter_visit_default(|name, link| {
        match link.link_type {
            LinkType::Hard => names.push(name.to_owned()),
            LinkType::Soft | LinkType::External => elsewhere = Some(format!("`{name}` is a link to another place")),
        }
        Ok(())
    })?;
    if elsewhere.is_some() {
        return Ok(elsewhere);
    }
    for name in names {
        let refused = match group.dataset(&name) {
            Ok(dataset) => check_elements(&dataset, &name, length, manifest)?,
            Err(_) => check_group(&group.group(&name)?, length, depth + 1, manifest)?,
        };
        if refused.is_some() {
            return Ok(refused);
        }
    }
    Ok(None)
}

/// The virtual datasets of a manifest are never read here, nor are the scales of axes.
fn check_elements(dataset: &hdf5::Dataset, name: &str, length: u64, manifest: bool) -> hdf5::Result<Option<String>> {
    let is_shown = manifest && name != "parts" && dataset.layout() == Layout::Virtual;
    if is_shown || scales::is_scale(&dataset.attr_names()?) {
        return Ok(None);
    }
    let size = dataset.dtype()?.size() as u64;
    let bytes = dataset
        .get_shape()?
        .iter()
        .fold(size, |bytes, &n| bytes.saturating_mul(n as u64));
    let inside = matches!(dataset.layout(), Layout::Contiguous | Layout::Compact) && bytes <= length;
    if bytes > 0 && (!inside || !dataset.create_plist()?.get_external()?.is_empty()) {
        return Ok(Some(format!("the elements of `{name}` are not in the file")));
    }
    Ok(None)
}

fn list(group: &Group, prefix: &str, contents: &mut Vec<Content>) -> hdf5::Result<()> {
    for name in group.member_names()? {
        let path = format!("{prefix}{name}");
        if path == "provenance" {
            continue;
        }
        match group.dataset(&name) {
            Ok(dataset) if scales::is_scale(&dataset.attr_names()?) => {}
            Ok(dataset) => contents.push(describe(&dataset, path)?),
            Err(_) => list(&group.group(&name)?, &format!("{path}/"), contents)?,
        }
    }
    Ok(())
}

fn describe(dataset: &hdf5::Dataset, path: String) -> hdf5::Result<Content> {
    let names = dataset.attr_names()?;
    let text = |name: &str| match names.iter().any(|other| other == name) {
        true => attribute(dataset, name),
        false => Ok(String::new()),
    };
    let axes = match names.iter().any(|name| name == AXES) {
        true => axes(dataset)?,
        false => Vec::new(),
    };
    Ok(Content {
        kind: element_type(&dataset.dtype()?.to_descriptor()?)
            .ok_or_else(|| format!("dataset `{path}` has a type that artifacts do not use"))?,
        shape: dataset.get_shape()?,
        units: text("units")?,
        description: text("description")?,
        axes,
        path,
    })
}

fn element_type(descriptor: &TypeDescriptor) -> Option<ElementType> {
    match descriptor {
        TypeDescriptor::Unsigned(IntSize::U1) => Some(ElementType::U8),
        TypeDescriptor::Unsigned(IntSize::U4) => Some(ElementType::U32),
        TypeDescriptor::Unsigned(IntSize::U8) => Some(ElementType::U64),
        TypeDescriptor::Float(FloatSize::U4) => Some(ElementType::F32),
        TypeDescriptor::Float(FloatSize::U8) => Some(ElementType::F64),
        TypeDescriptor::FixedUnicode(TEXT_WIDTH) => Some(ElementType::Text),
        _ => None,
    }
}

fn attributes(location: &hdf5::Location) -> hdf5::Result<BTreeMap<String, String>> {
    let mut out = BTreeMap::new();
    for name in location.attr_names()? {
        let value = attribute(location, &name)?;
        out.insert(name, value);
    }
    Ok(out)
}

fn attribute(location: &hdf5::Location, name: &str) -> hdf5::Result<String> {
    let value: VarLenUnicode = location.attr(name)?.read_scalar()?;
    utf8(value.as_bytes(), name)
}

fn axes(dataset: &hdf5::Dataset) -> hdf5::Result<Vec<String>> {
    let labels: Vec<VarLenUnicode> = dataset.attr(AXES)?.read_raw()?;
    if labels.len() != dataset.ndim() {
        return Err(format!("`{AXES}` has {} names for {} axes", labels.len(), dataset.ndim()).into());
    }
    labels.iter().map(|label| utf8(label.as_bytes(), AXES)).collect()
}

fn texts(dataset: &hdf5::Dataset) -> hdf5::Result<Vec<String>> {
    let cells: Vec<TextCell> = dataset.read_raw()?;
    cells.iter().map(|cell| utf8(cell.as_bytes(), "text")).collect()
}

/// The library's own conversion takes the bytes on trust.
fn utf8(bytes: &[u8], name: &str) -> hdf5::Result<String> {
    String::from_utf8(bytes.to_vec()).map_err(|_| format!("`{name}` is not UTF-8").into())
}
