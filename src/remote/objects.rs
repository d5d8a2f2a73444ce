//! Which objects a remote has, and which of them were found invalid.
//!
//! Records outlive objects: somebody may remove or overwrite these. So the objects are listed once for a command, when
//! it first needs one. An object that is listed, but invalid or refused, is noted in the store with its time and size,
//! so that later commands do not count on it until it is replaced, and the next push from this store replaces it. An
//! interrupted download is noted too: nobody knows whether the object is valid.

use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use super::bucket::Bucket;
use super::error::RemoteError;
use super::upstream::{OBJECTS, object_of};
use deaflow_base::{ArtifactId, read_own, write_output};

/// Maximum length of a note, bytes.
const MAX_NOTE: u64 = 4 << 10;

/// The first line of the note on an interrupted download, in place of the stamp.
const INTERRUPTED: &str = "interrupted";

/// The state of an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ObjectState {
    /// The remote has it.
    Present,
    /// The remote does not have it.
    Absent,
    /// It was invalid or refused when it was last downloaded, for this reason, and has not been replaced.
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
    /// Whether objects that were invalid are counted on again.
    retries: AtomicBool,
}

impl Objects {
    /// Creates the table with the folder of its notes.
    pub fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            listed: Mutex::default(),
            retries: AtomicBool::new(false),
        }
    }

    /// Counts on objects again that were invalid, so that they are downloaded once more. Their notes stay until that
    /// succeeds.
    pub fn retry(&self) {
        self.retries.store(true, Ordering::Relaxed);
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
            Some(_) if self.retries.load(Ordering::Relaxed) => ObjectState::Present,
            Some(stamp) => self
                .invalid(artifact, stamp)
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
            .filter(|(artifact, stamp)| self.invalid(artifact, stamp).is_none());
        Ok(valid.map(|(artifact, _)| *artifact).collect())
    }

    fn path(&self, artifact: &ArtifactId) -> PathBuf {
        self.folder.join(artifact.to_string())
    }

    /// Returns the stamp in the note on an object, and why it was invalid.
    fn note(&self, artifact: &ArtifactId) -> Option<(String, String)> {
        let text = String::from_utf8(read_own(&self.path(artifact), MAX_NOTE).ok()?).ok()?;
        let (stamp, why) = text.split_once('\n')?;
        Some((stamp.to_owned(), why.trim_end().to_owned()))
    }

    /// Returns why the object of this stamp was invalid, if it was.
    fn invalid(&self, artifact: &ArtifactId, stamp: &Stamp) -> Option<String> {
        let (of, why) = self.note(artifact)?;
        (of == stamp_text(stamp)).then_some(why)
    }

    /// Returns the stamp of an object, if it is listed.
    fn listed_stamp(&self, artifact: &ArtifactId) -> Option<Stamp> {
        self.lock().as_ref()?.as_ref()?.get(artifact).copied()
    }

    /// Whether the last download of an object was interrupted.
    pub fn is_interrupted(&self, artifact: &ArtifactId) -> bool {
        self.note(artifact).is_some_and(|(stamp, _)| stamp == INTERRUPTED)
    }

    /// Notes that an object is invalid. Without the note a later command finds that again.
    pub fn note_invalid(&self, artifact: &ArtifactId, why: &str) {
        if let Some(stamp) = self.listed_stamp(artifact) {
            self.write(artifact, &stamp_text(&stamp), why);
        }
    }

    /// Notes that the download of an object was interrupted, unless it is known to be invalid.
    pub fn note_interrupted(&self, artifact: &ArtifactId, why: &str) {
        let stamp = self.listed_stamp(artifact);
        if stamp.is_none_or(|stamp| self.invalid(artifact, &stamp).is_none()) {
            self.write(artifact, INTERRUPTED, why);
        }
    }

    fn write(&self, artifact: &ArtifactId, stamp: &str, why: &str) {
        let why: String = why.chars().take(1000).collect();
        if fs::create_dir_all(&self.folder).is_ok() {
            let _ = write_output(&self.path(artifact), format!("{stamp}\n{why}\n").as_bytes());
        }
    }

    /// Removes the note on an object that was replaced or downloaded.
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
