//! Which files are known to be sound: those that this process has written or digested, and those of which the store's index
//! says so.
//!
//! Whatever is read is digested once in each process. Whether something is there and whole, which is all that a plan asks, is
//! answered by the stamp of its file alone where the index knows it.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::delayed_names;
use super::entries::is_file;
use super::error::StoreError;
use super::header::Header;
use super::index::{self, Entries, Entry, Structure};
use super::layout::Layout;
use super::listing::Listing;
use super::read::{self, Access};
use super::session::StoreSession;
use super::stamp::{Stamp, Time, machine_time};
use deaflow_base::{ArtifactId, look_at_own};

/// How a file is known to be sound.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Check {
    /// This process wrote it.
    Written,
    /// This process has digested it, after this time; none where the file system's clock cannot be read.
    Read(Option<Time>),
}

struct VerifiedFile {
    check: Check,
    stamp: Stamp,
    header: Header,
    structure: Option<Structure>,
}

/// The memory of sound files, by artifact: in one store each has one file.
#[derive(Default)]
pub struct Verified {
    /// Where the index is and where files may be made; none outside a store.
    folders: Option<Folders>,
    indexed: Entries,
    memory: Mutex<Memory>,
}

struct Folders {
    index: PathBuf,
    session: Arc<StoreSession>,
    quarantine: PathBuf,
}

impl Folders {
    fn of(layout: &Layout, session: Arc<StoreSession>) -> Self {
        Self {
            index: layout.index(session.host()),
            session,
            quarantine: layout.quarantine(),
        }
    }

    /// The time by the clock that stamps files; by that of the machine where no file can be made.
    fn now(&self) -> Time {
        self.session.temporary_folder.time().unwrap_or_else(machine_time)
    }
}

#[derive(Default)]
struct Memory {
    known: HashMap<ArtifactId, VerifiedFile>,
    /// Each listing once, however many chunks have it.
    listings: HashSet<Arc<Listing>>,
    /// Artifacts whose files are gone or not sound.
    forgotten: HashSet<ArtifactId>,
    /// The file system's clock before the first file was digested.
    began: Option<Option<Time>>,
    changed: bool,
}

impl Verified {
    /// The memory of a store with an index, which is read here, and written by [`Verified::keep`].
    pub fn with_index(layout: &Layout, session: Arc<StoreSession>) -> Self {
        let mut known = Self::without_index(layout, session);
        if let Some(folders) = known.folders.as_ref().filter(|folders| folders.index.exists()) {
            known.indexed = index::read(&folders.index, folders.now());
        }
        known
    }

    /// The memory of a store whose index is written but not believed.
    pub fn without_index(layout: &Layout, session: Arc<StoreSession>) -> Self {
        let mut known = Self::default();
        known.folders = Some(Folders::of(layout, session));
        known
    }

    /// Verifies every byte of the file of an artifact, unless this process wrote it or has done so, and the file is as it
    /// was.
    ///
    /// # Errors
    /// When it is missing, damaged, or another artifact.
    pub fn verify(&self, path: &Path, digest: &ArtifactId) -> Result<Header, StoreError> {
        let before = stamp(path, digest)?;
        if let Some(header) = self.known(digest, &before) {
            return Ok(header);
        }
        let began = self.began();
        let header = Header::verify(path).and_then(|header| named(path, digest, header));
        let header = header.inspect_err(|_| self.forget(digest))?;
        let after = stamp(path, digest)?;
        let mut memory = self.lock();
        // A file that was written meanwhile is looked at again next time.
        if before == after {
            let structure = memory.known.remove(digest).and_then(|known| known.structure);
            memory.insert(digest, Check::Read(began), after, header, structure);
        }
        Ok(header)
    }

    /// As [`Verified::verify`], but believing the index where the file's stamp is the one that it knows; and what stands in the file,
    /// where that is known without opening it.
    ///
    /// # Errors
    /// When it is missing, damaged, or another artifact.
    pub fn glance(&self, path: &Path, digest: &ArtifactId) -> Result<(Header, Option<Structure>), StoreError> {
        if let Some(entry) = self.indexed(path, digest)? {
            return Ok((entry.header(*digest), entry.structure.clone()));
        }
        let header = self.verify(path, digest)?;
        Ok((header, self.known_structure(digest)))
    }

    fn known_structure(&self, digest: &ArtifactId) -> Option<Structure> {
        self.lock().known.get(digest).and_then(|known| known.structure.clone())
    }

    /// What stands in an artifact, whose file is opened only where neither this process nor the index knows.
    ///
    /// # Errors
    /// When it is missing, damaged, or another artifact.
    pub fn structure(&self, path: &Path, digest: &ArtifactId) -> Result<Structure, StoreError> {
        let indexed = self.indexed(path, digest)?;
        if let Some(structure) = indexed.and_then(|entry| entry.structure.clone()) {
            return Ok(structure);
        }
        self.verify(path, digest)?;
        if let Some(structure) = self.known_structure(digest) {
            return Ok(structure);
        }
        let overview = read::overview(Access::Guarded, path)?;
        Ok(self.describe(digest, overview.listing, overview.parts))
    }

    /// Whether it is known what stands in a file that has been verified: this process wrote it, or another one has read it.
    ///
    /// # Errors
    /// When it is missing.
    pub fn is_described(&self, path: &Path, digest: &ArtifactId) -> Result<bool, StoreError> {
        let indexed = self.indexed(path, digest)?;
        Ok(indexed.is_some_and(|entry| entry.structure.is_some()) || self.known_structure(digest).is_some())
    }

    /// Takes note of what stands in an artifact that has been verified.
    pub fn describe(&self, digest: &ArtifactId, listing: Listing, parts: Vec<ArtifactId>) -> Structure {
        let mut memory = self.lock();
        let listing = Arc::new(listing);
        memory.listings.insert(listing.clone());
        let structure = Structure {
            listing: memory.listings.get(&listing).cloned().unwrap_or(listing),
            parts: Arc::new(parts),
        };
        if let Some(known) = memory.known.get_mut(digest).filter(|known| known.structure.is_none()) {
            known.structure = Some(structure.clone());
            memory.changed = true;
        }
        structure
    }

    /// Takes note of a file that this process has just written.
    pub fn remember(&self, path: &Path, header: Header) {
        if let Ok(stamp) = stamp(path, &header.content) {
            self.lock().insert(&header.content, Check::Written, stamp, header, None);
        }
    }

    /// Takes note of a file that is gone or not sound, whatever the index says.
    pub fn forget(&self, digest: &ArtifactId) {
        let mut memory = self.lock();
        memory.known.remove(digest);
        memory.forgotten.insert(*digest);
        memory.changed = true;
    }

    /// Writes the index, where anything has been learnt that it does not know. It is a cache: where it cannot be written the
    /// next process verifies more, and that is all, so nothing is said of it.
    pub fn keep(&self) {
        let Some(folders) = &self.folders else { return };
        if std::mem::take(&mut self.lock().changed) {
            let _ = self.write(folders);
        }
    }

    /// Stamps are young when the files have just been written: they are let settle first, which takes some milliseconds.
    fn write(&self, folders: &Folders) -> Option<()> {
        let now = folders.session.temporary_folder.time()?;
        let unsettled = |known: &&VerifiedFile| known.check == Check::Written && !known.stamp.is_settled(now);
        let wait = self
            .lock()
            .known
            .values()
            .filter(unsettled)
            .map(|k| k.stamp.settles_after())
            .max();
        let now = match wait {
            // A coarse clock is not waited for: those files are verified by the next process.
            Some(wait) if wait.as_millis() < 100 => {
                std::thread::sleep(wait);
                folders.session.temporary_folder.time()?
            }
            _ => now,
        };
        let mut entries = index::read(&folders.index, now);
        self.add_to(&mut entries, now);
        let mut file = folders.session.temporary_folder.file().ok()?;
        file.write_all(&index::write(&entries)).ok()?;
        if !is_file(&folders.index) && fs::symlink_metadata(&folders.index).is_ok() {
            // Nobody knows whose it is: it is moved aside and not removed.
            let own = tempfile::Builder::new()
                .prefix("index.")
                .tempdir_in(&folders.quarantine);
            fs::rename(&folders.index, own.ok()?.keep().join("index")).ok()?;
        }
        file.persist(&folders.index).ok()?;
        Some(())
    }

    /// Writes the present stamp of a file into the index.
    pub fn believe(index: &Path, path: &Path, digest: &ArtifactId) {
        let stamp = stamp(path, digest).unwrap();
        std::thread::sleep(stamp.settles_after());
        let now = super::stamp::file_system_time(index.parent().unwrap()).unwrap();
        let mut entries = index::read(index, now);
        let entry = entries.get_mut(digest).unwrap();
        (entry.stamp, entry.noted) = (stamp, now);
        fs::write(index, index::write(&entries)).unwrap();
    }

    fn add_to(&self, entries: &mut Entries, now: Time) {
        let memory = self.lock();
        for digest in &memory.forgotten {
            entries.remove(digest);
        }
        for (digest, known) in &memory.known {
            let noted = match known.check {
                Check::Written => Some(now),
                Check::Read(began) => began,
            };
            let noted = noted.filter(|noted| known.stamp.is_settled(*noted));
            if let Some(noted) = noted {
                let of_others = || {
                    entries
                        .get(digest)
                        .filter(|other| other.stamp == known.stamp)?
                        .structure
                        .clone()
                };
                let structure = known.structure.clone().or_else(of_others);
                let entry = Entry {
                    file: known.header.file,
                    stamp: known.stamp,
                    noted,
                    structure,
                };
                entries.insert(*digest, entry);
            }
        }
    }

    /// What the index says of a file, if its stamp is the one that the index knows.
    fn indexed(&self, path: &Path, digest: &ArtifactId) -> Result<Option<&Entry>, StoreError> {
        let Some(entry) = self.indexed.get(digest) else {
            return Ok(None);
        };
        if self.lock().forgotten.contains(digest) {
            return Ok(None);
        }
        Ok((stamp(path, digest)? == entry.stamp).then_some(entry))
    }

    /// What this process knows of a file with this stamp. One that it has digested within a tick of its last change may
    /// have changed again in that tick.
    fn known(&self, digest: &ArtifactId, stamp: &Stamp) -> Option<Header> {
        let memory = self.lock();
        let known = memory.known.get(digest).filter(|known| known.stamp == *stamp)?;
        let settled = match known.check {
            Check::Written => true,
            Check::Read(began) => began.is_none_or(|began| known.stamp.is_settled(began)),
        };
        settled.then_some(known.header)
    }

    /// The file system's clock before the first file was digested: a file that has changed since is not settled.
    fn began(&self) -> Option<Time> {
        let folders = self.folders.as_ref()?;
        *self
            .lock()
            .began
            .get_or_insert_with(|| folders.session.temporary_folder.time())
    }

    fn lock(&self) -> MutexGuard<'_, Memory> {
        // A panic elsewhere while the memory was held leaves it whole: entries are inserted in one step.
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What was found damaged must not be believed by the next process, however this one ends.
impl Drop for Verified {
    fn drop(&mut self) {
        if !self.lock().forgotten.is_empty() {
            self.keep();
        }
    }
}

impl Memory {
    fn insert(
        &mut self,
        digest: &ArtifactId,
        check: Check,
        stamp: Stamp,
        header: Header,
        structure: Option<Structure>,
    ) {
        self.changed = true;
        self.forgotten.remove(digest);
        let known = VerifiedFile {
            check,
            stamp,
            header,
            structure,
        };
        self.known.insert(*digest, known);
    }
}

fn stamp(path: &Path, digest: &ArtifactId) -> Result<Stamp, StoreError> {
    match delayed_names::if_listed(path, || look_at_own(path)) {
        Ok(metadata) if metadata.is_symlink() => Err(StoreError::damaged(path, "it is a link")),
        Ok(metadata) => Ok(Stamp::of(&metadata)),
        Err(error) if delayed_names::is_late(&error) => Err(StoreError::Missing {
            digest: *digest,
            path: path.to_owned(),
        }),
        Err(error) => Err(StoreError::io("read", path)(error)),
    }
}

fn named(path: &Path, digest: &ArtifactId, header: Header) -> Result<Header, StoreError> {
    if header.content == *digest {
        Ok(header)
    } else {
        let reason = format!("it holds artifact {}", header.content.short());
        Err(StoreError::damaged(path, reason))
    }
}
