//! Pins: artifacts that a collection must keep whatever the runs say. A pin is a file named by the artifact's digest.

use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::atomic;
use super::entries::{files_in_optional, is_hidden};
use super::error::StoreError;
use super::open::Store;
use deaflow_base::{ArtifactId, read_own};

/// A label comes from the command line, which has at most so many bytes.
const MAX_BYTES: u64 = 4 << 20;

/// A pinned artifact.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pin {
    /// The artifact.
    pub digest: ArtifactId,
    /// Why it is kept, in the words of whoever pinned it.
    pub label: String,
    /// When it was pinned, in UTC, RFC 3339.
    pub created: String,
    /// Whether it is kept without what it was made from.
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
    /// Pins an artifact; a pin that is there already is replaced.
    ///
    /// # Errors
    /// When the artifact is missing or damaged, or what it was made from is not all here, unless it is pinned alone; or the system refuses.
    pub fn pin(&self, pin: &Pin) -> Result<(), StoreError> {
        self.artifact(&pin.digest)?;
        if !pin.result_only {
            // A collection would refuse to go on, and say so only then.
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

    /// Removes the pin of an artifact; `false` where there was none.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn unpin(&self, digest: &ArtifactId) -> Result<bool, StoreError> {
        let path = self.layout.pins().join(digest.to_string());
        match fs::remove_file(&path) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
            Err(error) => Err(StoreError::io("remove", &path)(error)),
        }
    }

    /// All pins, in the order of their digests. What a file says may be lost to damage, but not that it is a pin. One that is
    /// named by no digest is none.
    ///
    /// # Errors
    /// When the system refuses.
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
                label: "(its file is damaged)".into(),
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

    /// What lies among the pins and is none.
    pub(super) fn stray_pins(&self) -> Result<Vec<PathBuf>, StoreError> {
        let is_stray = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str());
            !is_hidden(path) && name.is_none_or(|name| name.parse::<ArtifactId>().is_err())
        };
        let files = files_in_optional(&self.layout.pins())?;
        Ok(files.into_iter().filter(is_stray).collect())
    }
}
