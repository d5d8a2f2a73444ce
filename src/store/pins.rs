//! Pins: artifacts that garbage collection must keep. A pin is a file named by the digest of the artifact.

use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::atomic;
use super::entries::{files_in_optional, is_hidden};
use super::error::StoreError;
use super::open::Store;
use deaflow_base::{ArtifactId, read_own};

/// Maximum length of the file: a label from the command line is shorter.
const MAX_BYTES: u64 = 4 << 20;

/// A pinned artifact.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pin {
    /// The artifact.
    pub digest: ArtifactId,
    /// Why it is kept, as given by the user.
    pub label: String,
    /// When it was pinned, in UTC, RFC 3339.
    pub created: String,
    /// Whether it is kept without its inputs.
    pub result_only: bool,
}

#[derive(Serialize, Deserialize)]
struct Content {
    label: String,
    created: String,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    result_only: bool,
}

impl Store {
    /// Pins an artifact; replaces an existing pin.
    ///
    /// # Errors
    /// If the artifact is missing or damaged, one of its inputs is missing (unless only the result is pinned), or the
    /// system reports an error.
    pub fn pin(&self, pin: &Pin) -> Result<(), StoreError> {
        self.artifact(&pin.digest)?;
        if !pin.result_only {
            // A later garbage collection would fail.
            let (_, missing) = self.dependencies(vec![pin.digest], &self.known_records()?)?;
            if let Some(missing) = missing.first() {
                return Err(StoreError::IncompleteInputs {
                    digest: pin.digest,
                    missing: *missing,
                });
            }
        }
        let content = Content {
            label: pin.label.clone(),
            created: pin.created.clone(),
            result_only: pin.result_only,
        };
        let text = serde_json::to_vec_pretty(&content)?;
        let folder = self.temporary()?;
        let target = self.layout.pins().join(pin.digest.to_string());
        atomic::write(&folder.path().join("pin"), &target, &text)
    }

    /// Removes the pin of an artifact; returns `false` if there was none.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn unpin(&self, digest: &ArtifactId) -> Result<bool, StoreError> {
        let path = self.layout.pins().join(digest.to_string());
        match fs::remove_file(&path) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
            Err(error) => Err(StoreError::io("remove", &path)(error)),
        }
    }

    /// Returns all pins, in the order of their digests. A damaged file still counts as a pin; one that is not named by
    /// a digest does not.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn pins(&self) -> Result<Vec<Pin>, StoreError> {
        let mut pins = Vec::new();
        for path in files_in_optional(&self.layout.pins())? {
            let name = path.file_name().and_then(|name| name.to_str());
            let Some(digest) = name.and_then(|name| name.parse().ok()) else {
                continue;
            };
            let content = match read_own(&path, MAX_BYTES) {
                Ok(bytes) => serde_json::from_slice(&bytes).ok(),
                Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::FileTooLarge) => None,
                Err(error) => return Err(StoreError::io("read", &path)(error)),
            };
            let content = content.unwrap_or(Content {
                label: "(the file of the pin is damaged)".into(),
                created: String::new(),
                result_only: false,
            });
            pins.push(Pin {
                digest,
                label: content.label,
                created: content.created,
                result_only: content.result_only,
            });
        }
        Ok(pins)
    }

    /// Returns the files in the folder of pins that are not pins.
    pub(super) fn stray_pins(&self) -> Result<Vec<PathBuf>, StoreError> {
        let is_stray = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str());
            !is_hidden(path) && name.is_none_or(|name| name.parse::<ArtifactId>().is_err())
        };
        let files = files_in_optional(&self.layout.pins())?;
        Ok(files.into_iter().filter(is_stray).collect())
    }
}
