//! Which objects a remote has, and which of them were found invalid.
//!
//! Records outlive objects: somebody may remove or overwrite these. So the objects are listed once for a command, when
//! it first needs one. An object that was downloaded and is invalid is noted in the store with its time and size, so
//! that later commands do not count on it until it is replaced, and the next push from this store replaces it.

use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use super::bucket::Bucket;
use super::error::RemoteError;
use super::upstream::{OBJECTS, object_of};
use deaflow_base::{ArtifactId, read_own, write_output};

/// Maximum length of a note, bytes.
const MAX_NOTE: u64 = 4 << 10;

/// The state of an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ObjectState {
    /// The remote has it.
    Present,
    /// The remote does not have it.
    Absent,
    /// It was invalid when it was last downloaded, for this reason, and has not been replaced.
    Invalid(String),
    /// The objects could not be listed.
    Unknown,
}

/// Size and time of an object.
type Stamp = (u64, SystemTime);

/// The objects that a remote has.
type Listing = Arc<BTreeMap<ArtifactId, Stamp>>;

/// The objects of a remote.
pub struct Objects {
    /// Folder of the notes.
    folder: PathBuf,
    /// Those that the remote has, once they are listed; `None` if that failed.
    listed: Mutex<Option<Option<Listing>>>,
}

impl Objects {
    /// Creates the table with the folder of its notes.
    pub fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            listed: Mutex::default(),
        }
    }

    /// Lists the objects anew when they are next needed.
    pub fn refresh(&self) {
        *self.lock() = None;
    }

    fn lock(&self) -> MutexGuard<'_, Option<Option<Listing>>> {
        // It is replaced in one step.
        self.listed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the objects, listing them on first use. `failed` receives the error.
    fn list(&self, bucket: &dyn Bucket, failed: &dyn Fn(&RemoteError)) -> Option<Listing> {
        let mut listed = self.lock();
        if let Some(known) = &*listed {
            return known.clone();
        }
        let found = match stamps(bucket) {
            Ok(stamps) => Some(Arc::new(stamps)),
            Err(error) => {
                failed(&error);
                None
            }
        };
        *listed = Some(found.clone());
        found
    }

    /// Returns the state of the object of an artifact.
    pub fn state(&self, artifact: &ArtifactId, bucket: &dyn Bucket, failed: &dyn Fn(&RemoteError)) -> ObjectState {
        let Some(listed) = self.list(bucket, failed) else {
            return ObjectState::Unknown;
        };
        match listed.get(artifact) {
            None => ObjectState::Absent,
            Some(stamp) => self
                .note(artifact, stamp)
                .map_or(ObjectState::Present, ObjectState::Invalid),
        }
    }

    /// Lists the objects now, and returns those that are not noted as invalid.
    ///
    /// # Errors
    /// Returns an error if they cannot be listed.
    pub fn valid(&self, bucket: &dyn Bucket) -> Result<HashSet<ArtifactId>, RemoteError> {
        let stamps = stamps(bucket)?;
        let valid = stamps
            .iter()
            .filter(|(artifact, stamp)| self.note(artifact, stamp).is_none());
        Ok(valid.map(|(artifact, _)| *artifact).collect())
    }

    /// Returns the artifacts with a note.
    pub fn noted(&self) -> Vec<ArtifactId> {
        let entries = fs::read_dir(&self.folder).into_iter().flatten();
        entries
            .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok())
            .collect()
    }

    fn path(&self, artifact: &ArtifactId) -> PathBuf {
        self.folder.join(artifact.to_string())
    }

    /// Returns why the object of this stamp was invalid, if it was.
    fn note(&self, artifact: &ArtifactId, stamp: &Stamp) -> Option<String> {
        let text = String::from_utf8(read_own(&self.path(artifact), MAX_NOTE).ok()?).ok()?;
        let (of, why) = text.split_once('\n')?;
        (of == stamp_text(stamp)).then(|| why.trim_end().to_owned())
    }

    /// Notes that an object is invalid. Without the note a later command finds that again.
    pub fn note_invalid(&self, artifact: &ArtifactId, why: &str) {
        let stamp = self
            .lock()
            .as_ref()
            .and_then(|listed| listed.as_ref()?.get(artifact).copied());
        let Some(stamp) = stamp else { return };
        let why: String = why.chars().take(1000).collect();
        let text = format!("{}\n{why}\n", stamp_text(&stamp));
        if fs::create_dir_all(&self.folder).is_ok() {
            let _ = write_output(&self.path(artifact), text.as_bytes());
        }
    }

    /// Removes the note on an object, which was replaced or is to be downloaded again.
    pub fn forget(&self, artifact: &ArtifactId) {
        let _ = fs::remove_file(self.path(artifact));
    }
}

/// Lists the objects of a remote.
fn stamps(bucket: &dyn Bucket) -> Result<BTreeMap<ArtifactId, Stamp>, RemoteError> {
    let entries = bucket.list(OBJECTS)?.into_iter();
    let stamps = entries.filter_map(|entry| Some((object_of(&entry.name)?, (entry.size, entry.modified))));
    Ok(stamps.collect())
}

fn stamp_text((size, modified): &Stamp) -> String {
    format!("{size} {}", humantime::format_rfc3339_nanos(*modified))
}
