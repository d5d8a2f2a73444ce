//! The datasets of an artifact without their elements.

use serde::{Deserialize, Serialize};

use super::element_type::ElementType;
use super::error::StoreError;
use super::object::{Dataset, Object};
use deaflow_base::ArtifactId;

/// Kind and datasets of an artifact.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Listing {
    /// Kind of the action that makes it.
    pub kind: String,
    /// Its datasets in the order of their paths; empty for a manifest, whose chunks have them.
    pub contents: Vec<Content>,
}

/// One dataset of an artifact.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Content {
    /// Its path ("patterns", "unstable/patterns").
    pub path: String,
    /// Type of its elements.
    pub kind: ElementType,
    /// Its extents, slowest first; of a manifest, those of all chunks together.
    pub shape: Vec<usize>,
    /// Unit of the elements.
    pub units: String,
    /// Its description.
    pub description: String,
    /// Names of its axes, slowest first; empty where they have none.
    pub axes: Vec<String>,
}

impl Content {
    /// Returns why two datasets cannot be concatenated, if so.
    fn mismatch(&self, other: &Self) -> Option<String> {
        let path = &self.path;
        if self.kind != other.kind {
            return Some(format!(
                "`{path}` has type {}, not {}",
                other.kind.name(),
                self.kind.name()
            ));
        }
        if self.shape.is_empty() {
            return Some(format!("`{path}` is a scalar, so chunks cannot be concatenated"));
        }
        if Some(&self.shape[1..]) != other.shape.get(1..) {
            return Some(format!(
                "`{path}` has the shape {:?}, not {:?}",
                other.shape, self.shape
            ));
        }
        (self.units != other.units).then(|| format!("`{path}` has another unit"))
    }
}

/// Returns the listing of an object.
pub fn of_object(object: &Object) -> Listing {
    let describe = |(path, dataset): (&String, &Dataset)| Content {
        path: path.clone(),
        kind: ElementType::of(&dataset.data),
        shape: dataset.shape.clone(),
        units: dataset.units.clone(),
        description: dataset.description.clone(),
        axes: dataset.axes.clone(),
    };
    Listing {
        kind: object.kind.clone(),
        contents: object.datasets.iter().map(describe).collect(),
    }
}

/// Concatenates the datasets of chunks along the first axis.
///
/// # Errors
/// If the chunks differ in anything but their first extents.
pub fn concatenate<'a>(
    parts: impl IntoIterator<Item = (ArtifactId, &'a [Content])>,
) -> Result<Vec<Content>, StoreError> {
    let mut whole: Option<Vec<Content>> = None;
    for (digest, contents) in parts {
        let refuse = |reason: String| StoreError::Parts { digest, reason };
        let Some(whole) = &mut whole else {
            if let Some(reason) = contents.iter().find_map(|c| c.mismatch(c)) {
                return Err(refuse(reason));
            }
            whole = Some(contents.to_vec());
            continue;
        };
        if let Some((ours, _)) = whole.iter().zip(contents).find(|(a, b)| a.path != b.path) {
            return Err(refuse(format!("only one of them has `{}`", ours.path)));
        }
        if whole.len() != contents.len() {
            return Err(refuse(format!(
                "it has {} datasets, not {}",
                contents.len(),
                whole.len()
            )));
        }
        for (ours, theirs) in whole.iter_mut().zip(contents) {
            if let Some(reason) = ours.mismatch(theirs) {
                return Err(refuse(reason));
            }
            ours.shape[0] += theirs.shape[0];
        }
    }
    Ok(whole.unwrap_or_default())
}
