//! Reads everything in a file except elements, as far as this program writes it.

use std::collections::BTreeMap;
use std::path::Path;

use hdf5::{Dataset, File, Group, LinkType};
use serde::{Deserialize, Serialize};

use super::attributes;
use super::elements::Element;
use super::error::{Failure, system_error};
use super::storage;

/// Maximum depth of groups.
const DEEPEST: u32 = 16;

/// The dataset that makes a file a manifest. The other datasets of a manifest are virtual and never opened here: their
/// sources are in the global heap.
const PARTS: &str = "parts";

/// The group with the provenance.
const PROVENANCE: &str = "provenance";

/// The attribute of dimension scales, which are skipped.
const SCALE: &str = "CLASS";

/// The content of a file without the elements of its datasets.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tree {
    /// The attributes of the file.
    pub attributes: BTreeMap<String, String>,
    /// Those of `/provenance`, if there is such a group.
    pub provenance: Option<BTreeMap<String, String>>,
    /// The datasets, in the order of their paths; for a manifest only `parts`.
    pub arrays: Vec<Array>,
}

/// A dataset of such a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Array {
    /// Its path.
    pub path: String,
    /// Type of the elements.
    pub element: Element,
    /// Extents, slowest first.
    pub shape: Vec<usize>,
    /// Its unit.
    pub units: String,
    /// Its description.
    pub description: String,
    /// Names of its axes; may be empty.
    pub axes: Vec<String>,
}

/// Reads everything except elements. Refuses what this program never writes: links, deeply nested groups, and elements
/// that are not in the file.
pub(super) fn read(path: &Path, file: &File) -> Result<Tree, Failure> {
    let mut arrays = Vec::new();
    let length = std::fs::metadata(path).map_err(|e| Failure::unopened(&e))?.len();
    let (mut names, only) = (links(file)?, file.link_exists(PARTS));
    if only {
        names.retain(|name| name == PARTS);
    }
    for name in names {
        if name != PROVENANCE && name != attributes::LONG {
            list(file, &name, &name, (length, 0), &mut arrays)?;
        }
    }
    arrays.sort_by(|a: &Array, b| a.path.cmp(&b.path));
    Ok(Tree {
        attributes: attributes::all(file, length)?,
        provenance: match file.link_exists(PROVENANCE) {
            true => Some(attributes::all(&file.group(PROVENANCE)?, length)?),
            false => None,
        },
        arrays,
    })
}

/// Returns the names in a group; refuses links.
fn links(group: &Group) -> Result<Vec<String>, Failure> {
    let mut names = Vec::new();
    let mut elsewhere = None;
    group.iter_visit_default(|name, link| {
        match link.link_type {
            LinkType::Hard => names.push(name.to_owned()),
            LinkType::Soft | LinkType::External => elsewhere = Some(format!("`{name}` is a link")),
        }
        Ok(())
    })?;
    match elsewhere {
        Some(why) => Err(Failure::Refused(why)),
        None => Ok(names),
    }
}

fn list(
    group: &Group,
    name: &str,
    path: &str,
    (length, depth): (u64, u32),
    arrays: &mut Vec<Array>,
) -> Result<(), Failure> {
    if depth > DEEPEST {
        let why = format!("its groups are nested more than {DEEPEST} deep");
        return Err(Failure::Refused(why));
    }
    match group.dataset(name) {
        Ok(dataset) => arrays.extend(describe(&dataset, path, length)?),
        Err(error) if system_error(&error).is_some() => return Err(error.into()),
        Err(_) => {
            let inner = group.group(name)?;
            for name in links(&inner)? {
                list(&inner, &name, &format!("{path}/{name}"), (length, depth + 1), arrays)?;
            }
        }
    }
    Ok(())
}

/// Describes a dataset, unless it is a dimension scale.
fn describe(dataset: &Dataset, path: &str, length: u64) -> Result<Option<Array>, Failure> {
    let names = dataset.attr_names()?;
    let has = |name: &str| names.iter().any(|other| other == name);
    if has(SCALE) {
        return Ok(None);
    }
    if !storage::is_inside(dataset, length)? {
        let why = format!("the elements of `{path}` are not in the file");
        return Err(Failure::Refused(why));
    }
    let text = |name: &str| match has(name) {
        true => attributes::one(dataset, name),
        false => Ok(String::new()),
    };
    let shape = dataset.get_shape()?;
    Ok(Some(Array {
        path: path.to_owned(),
        element: storage::element(dataset)?,
        units: text("units")?,
        description: text("description")?,
        axes: attributes::axes(dataset, &names, shape.len())?,
        shape,
    }))
}
