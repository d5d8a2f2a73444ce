//! Declarations of arrays, and checks of artifacts against them.

use std::collections::BTreeMap;

use super::element::RASTER_AXES;
use super::error::Fault;
use deaflow_store::{Artifact, Content, ElementType, StoreError};

/// The declaration of an array.
#[derive(Clone, Debug, PartialEq)]
pub struct Declared {
    /// Its path in the file.
    pub path: String,
    /// Type of its elements.
    pub element: ElementType,
    /// Unit of its elements.
    pub units: &'static str,
    /// Names of its axes, slowest first.
    pub axes: Vec<String>,
    /// Lengths of the last axes, if the same in every artifact.
    pub extents: &'static [usize],
    /// Its description, one sentence.
    pub description: String,
    /// Whether artifacts may lack it.
    pub optional: bool,
}

impl Declared {
    /// Returns the axes whose lengths depend on the artifact.
    #[must_use]
    pub fn free_axes(&self) -> &[String] {
        &self.axes[..self.axes.len() - self.extents.len()]
    }

    /// Returns the shape as text, as in `(sample, y, x)`.
    #[must_use]
    pub fn shape(&self) -> String {
        let free = self.free_axes().iter().cloned();
        let all: Vec<String> = free.chain(self.extents.iter().map(ToString::to_string)).collect();
        format!("({})", all.join(", "))
    }

    fn fits(&self, shape: &[usize]) -> bool {
        shape.len() == self.axes.len() && shape.ends_with(self.extents)
    }
}

/// Checks the axes of the arrays of an artifact, and that lengths along a shared axis are equal. Reads only headers.
///
/// # Errors
/// If an array has other axes or another length than others, or a chunk is missing or damaged.
pub fn check(artifact: &Artifact, declared: &[Declared]) -> Result<(), StoreError> {
    let contents = artifact.contents()?;
    check_axes(contents, declared).map_err(|fault| fault.of(artifact.digest()))
}

fn check_axes(contents: &[Content], declared: &[Declared]) -> Result<(), Fault> {
    let mut known: BTreeMap<&str, (&str, usize)> = BTreeMap::new();
    check_raster(contents, declared)?;
    for array in declared {
        let Some(Content { shape, .. }) = contents.iter().find(|content| content.path == array.path) else {
            continue;
        };
        if !array.fits(shape) {
            return Err(Fault::Shape {
                path: array.path.clone(),
                found: shape.clone(),
                expected: array.shape(),
            });
        }
        for (axis, &found) in array.free_axes().iter().zip(shape) {
            let &mut (other, expected) = known.entry(axis).or_insert((&array.path, found));
            if found != expected {
                return Err(Fault::Length {
                    path: array.path.clone(),
                    axis: axis.clone(),
                    found,
                    other: other.to_owned(),
                    expected,
                });
            }
        }
    }
    Ok(())
}

/// Checks that there is one corner more than cells along each side.
fn check_raster(contents: &[Content], declared: &[Declared]) -> Result<(), Fault> {
    let length = |name: &str| {
        declared.iter().find_map(|array| {
            let at = array.free_axes().iter().position(|axis| axis == name)?;
            let content = contents.iter().find(|content| content.path == array.path)?;
            Some((&array.path, *content.shape.get(at)?))
        })
    };
    let [cells, corners] = RASTER_AXES;
    for (cell, corner) in cells.into_iter().zip(corners) {
        if let (Some((other, cells)), Some((path, found))) = (length(cell), length(corner))
            && found != cells + 1
        {
            return Err(Fault::Length {
                path: path.clone(),
                axis: corner.to_owned(),
                found,
                other: other.clone(),
                expected: cells + 1,
            });
        }
    }
    Ok(())
}
