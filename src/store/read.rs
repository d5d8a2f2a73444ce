//! Reads artifact files whose header has been verified.
//!
//! This program does not read virtual datasets: it reads and verifies the chunks of a manifest by their digests.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use super::element_type::ElementType;
use super::error::StoreError;
use super::listing::{Content, Listing};
use super::object::{Data, Dataset, KIND, TEXT_WIDTH};
use deaflow_base::ArtifactId;
use deaflow_hdf::{Array, Element, HdfError, HdfFile, Tree};

/// The dataset of a manifest with the digests of its chunks.
const PARTS: &str = "parts";

/// In which process a file is read, and whether it is trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// In this process: the file is in a store and its structure is known.
    Here,
    /// In another process: the file is in a store, but a checksum does not show who wrote it.
    Guarded,
    /// In another process: the user named the file, and it may come from anywhere.
    Apart,
}

impl Access {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn open(self, path: &Path) -> Result<HdfFile, StoreError> {
        let opened = match self {
            Self::Here => HdfFile::open_trusted(path),
            Self::Guarded => HdfFile::open_of_store(path),
            Self::Apart => HdfFile::open_untrusted(path),
        };
        opened.map_err(|error| self.error("open", path, error))
    }

    /// Returns the error for a failed read: damage for a file of a store, an invalid input for a file that the user
    /// named.
    pub(super) fn error(self, action: &'static str, path: &Path, error: HdfError) -> StoreError {
        match self {
            Self::Here | Self::Guarded => damage(action, path, error),
            Self::Apart => error.into(),
        }
    }
}

fn damage(action: &'static str, path: &Path, error: HdfError) -> StoreError {
    use deaflow_hdf::Failure;
    // An error of the system is not damage.
    if let HdfError::Failed { failure, .. } = &error
        && let Some(number) = failure.system_error()
    {
        return StoreError::io(action, path)(io::Error::from_raw_os_error(number));
    }
    match error {
        HdfError::Failed {
            failure: Failure::Unopened(ref message, _) | Failure::Library(ref message, _),
            ..
        } if StoreError::is_system_error(message) => StoreError::from_hdf5_message(action, path, message.clone()),
        HdfError::Process { path, source } => StoreError::Io {
            action: "start the process that reads",
            path,
            source,
        },
        error if error.is_of_the_file() => StoreError::damaged(path, error.reason()),
        error => error.into(),
    }
}

/// The content of a file without the elements of its datasets.
pub struct Overview {
    /// Content attributes.
    pub attributes: BTreeMap<String, String>,
    /// Digests of the chunks of a manifest.
    pub parts: Vec<ArtifactId>,
    /// Kind and datasets.
    pub listing: Listing,
}

/// Reads everything except the elements.
///
/// # Errors
/// If the file does not have the format that this program writes.
pub fn overview(access: Access, path: &Path) -> Result<Overview, StoreError> {
    let file = access.open(path)?;
    let failed = |error| access.error("read", path, error);
    let Tree {
        mut attributes, arrays, ..
    } = file.tree().map_err(failed)?;
    let kind = attributes.remove(KIND).unwrap_or_default();
    let is_manifest = arrays.iter().any(|array| array.path == PARTS);
    let (parts, contents) = match is_manifest {
        true => (parts(path, file.elements(PARTS).map_err(failed)?)?, Vec::new()),
        false => {
            let contents: Result<Vec<Content>, StoreError> =
                arrays.into_iter().map(|array| content(path, array)).collect();
            (Vec::new(), contents?)
        }
    };
    Ok(Overview {
        attributes,
        parts,
        listing: Listing { kind, contents },
    })
}

fn parts(path: &Path, elements: Data) -> Result<Vec<ArtifactId>, StoreError> {
    let Data::Text(texts) = elements else {
        return Err(StoreError::damaged(path, "the dataset `parts` does not contain texts"));
    };
    let parts: Result<Vec<ArtifactId>, _> = texts.iter().map(|text| text.parse()).collect();
    parts.map_err(|error| StoreError::damaged(path, error.to_string()))
}

impl Content {
    /// Describes a dataset of a file that is not an artifact.
    ///
    /// # Errors
    /// If its element type is not one of those of artifacts.
    pub fn of_file(path: &Path, array: Array) -> Result<Self, StoreError> {
        content(path, array)
    }
}

fn content(path: &Path, array: Array) -> Result<Content, StoreError> {
    let kind = element_type(&array.element).ok_or_else(|| {
        let reason = format!("dataset `{}` has an element type that artifacts do not use", array.path);
        StoreError::damaged(path, reason)
    })?;
    Ok(Content {
        kind,
        shape: array.shape,
        units: array.units,
        description: array.description,
        axes: array.axes,
        path: array.path,
    })
}

fn element_type(element: &Element) -> Option<ElementType> {
    match element {
        Element::U8 => Some(ElementType::U8),
        Element::U32 => Some(ElementType::U32),
        Element::U64 => Some(ElementType::U64),
        Element::F32 => Some(ElementType::F32),
        Element::F64 => Some(ElementType::F64),
        Element::Text(width) if *width == TEXT_WIDTH as u64 => Some(ElementType::Text),
        _ => None,
    }
}

/// Reads one dataset.
///
/// # Errors
/// If the file does not have the format that this program writes.
pub fn dataset(access: Access, path: &Path, content: &Content) -> Result<Dataset, StoreError> {
    let file = access.open(path)?;
    let data = file
        .elements(&content.path)
        .map_err(|error| access.error("read", path, error))?;
    let expected: usize = content.shape.iter().product();
    if ElementType::of(&data) != content.kind || data.len() != expected {
        return Err(StoreError::damaged(
            path,
            format!("type or size of `{}` have changed", content.path),
        ));
    }
    Ok(Dataset {
        units: content.units.clone(),
        description: content.description.clone(),
        axes: content.axes.clone(),
        shape: content.shape.clone(),
        data,
    })
}

/// Reads the attributes of `/provenance`.
///
/// # Errors
/// If the file does not have the format that this program writes.
pub fn provenance(access: Access, path: &Path) -> Result<BTreeMap<String, String>, StoreError> {
    let tree = access.open(path)?.tree();
    let tree = tree.map_err(|error| access.error("read", path, error))?;
    tree.provenance
        .ok_or_else(|| StoreError::damaged(path, "it has no provenance"))
}
