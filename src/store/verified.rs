//! Caches which files are known to be intact: those that this process has written or verified, and those in the index.
//!
//! Each file that is read is verified once per process. Planning only needs to know whether files are intact, for which
//! the stamp of a file in the index is enough.

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
use deaflow_base::{ArtifactId, own_metadata};

/// How a file is known to be intact.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Check {
    /// This process wrote it.
    Written,
    /// This process has verified it after this time; `None` if the clock of the file system cannot be read.
    Read(Option<Time>),
}

struct VerifiedFile {
    check: Check,
    stamp: Stamp,
    header: Header,
    structure: Option<Structure>,
}

/// The cache of intact files, by artifact.
#[derive(Default)]
pub struct Verified {
    /// The folders of the store; `None` outside a store.
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

    /// Returns the time of the clock of the file system, or of the machine if that cannot be read.
    fn now(&self) -> Time {
        self.session.temporary_folder.time().unwrap_or_else(machine_time)
    }
}

#[derive(Default)]
struct Memory {
    known: HashMap<ArtifactId, VerifiedFile>,
    /// Shares equal listings.
    listings: HashSet<Arc<Listing>>,
    /// Artifacts whose files are missing or damaged.
    forgotten: HashSet<ArtifactId>,
    /// Time of the file system before the first file was verified.
    began: Option<Option<Time>>,
    changed: bool,
}

impl Verified {
    /// Creates the cache of a store and reads its index.
    pub fn with_index(layout: &Layout, session: Arc<StoreSession>) -> Self {
        let mut known = Self::without_index(layout, session);
        if let Some(folders) = known.folders.as_ref().filter(|folders| folders.index.exists()) {
            known.indexed = index::read(&folders.index, folders.now());
        }
        known
    }

    /// Creates the cache of a store without reading its index.
    pub fn without_index(layout: &Layout, session: Arc<StoreSession>) -> Self {
        let mut known = Self::default();
        known.folders = Some(Folders::of(layout, session));
        known
    }

    /// Verifies every byte of the file of an artifact, unless this process has written or verified it and its stamp is
    /// unchanged.
    ///
    /// # Errors
    /// If it is missing, damaged, or another artifact.
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
        // A file that changed meanwhile is verified again next time.
        if before == after {
            let structure = memory.known.remove(digest).and_then(|known| known.structure);
            memory.insert(digest, Check::Read(began), after, header, structure);
        }
        Ok(header)
    }

    /// As [`Verified::verify`], but trusts the index if the stamp of the file is unchanged. Also returns the structure
    /// if it is known without opening the file.
    ///
    /// # Errors
    /// If it is missing, damaged, or another artifact.
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

    /// Returns the structure of an artifact. Its file is opened only if the structure is not known.
    ///
    /// # Errors
    /// If it is missing, damaged, or another artifact.
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

    /// Whether the structure of a verified file is known: this process wrote it, or another one has read it.
    ///
    /// # Errors
    /// If it is missing.
    pub fn is_described(&self, path: &Path, digest: &ArtifactId) -> Result<bool, StoreError> {
        let indexed = self.indexed(path, digest)?;
        Ok(indexed.is_some_and(|entry| entry.structure.is_some()) || self.known_structure(digest).is_some())
    }

    /// Adds the structure of a verified artifact.
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

    /// Adds a file that this process has just written.
    pub fn remember(&self, path: &Path, header: Header) {
        if let Ok(stamp) = stamp(path, &header.content) {
            self.lock().insert(&header.content, Check::Written, stamp, header, None);
        }
    }

    /// Removes a file that is missing or damaged, also from the index.
    pub fn forget(&self, digest: &ArtifactId) {
        let mut memory = self.lock();
        memory.known.remove(digest);
        memory.forgotten.insert(*digest);
        memory.changed = true;
    }

    /// Writes the index if it has changed. Errors are ignored: the next process verifies more files.
    pub fn keep(&self) {
        let Some(folders) = &self.folders else { return };
        if std::mem::take(&mut self.lock().changed) {
            let _ = self.write(folders);
        }
    }

    /// Writes the index, after waiting some milliseconds until the stamps of new files have settled.
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
            // With a coarse clock, the next process verifies those files instead.
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
            // It is not a file of the store, so it is moved to quarantine.
            let own = tempfile::Builder::new()
                .prefix("index.")
                .tempdir_in(&folders.quarantine);
            fs::rename(&folders.index, own.ok()?.keep().join("index")).ok()?;
        }
        file.persist(&folders.index).ok()?;
        Some(())
    }

    /// Writes the present stamp of a file into the index; for tests.
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

    /// Returns the index entry of a file if its stamp is unchanged.
    fn indexed(&self, path: &Path, digest: &ArtifactId) -> Result<Option<&Entry>, StoreError> {
        let Some(entry) = self.indexed.get(digest) else {
            return Ok(None);
        };
        if self.lock().forgotten.contains(digest) {
            return Ok(None);
        }
        Ok((stamp(path, digest)? == entry.stamp).then_some(entry))
    }

    /// Returns the header of a file with this stamp if this process knows it. A file that was verified within a tick of
    /// its last change may have changed again in that tick.
    fn known(&self, digest: &ArtifactId, stamp: &Stamp) -> Option<Header> {
        let memory = self.lock();
        let known = memory.known.get(digest).filter(|known| known.stamp == *stamp)?;
        let settled = match known.check {
            Check::Written => true,
            Check::Read(began) => began.is_none_or(|began| known.stamp.is_settled(began)),
        };
        settled.then_some(known.header)
    }

    /// Returns the time of the file system before the first file was verified: files that changed since are not
    /// settled.
    fn began(&self) -> Option<Time> {
        let folders = self.folders.as_ref()?;
        *self
            .lock()
            .began
            .get_or_insert_with(|| folders.session.temporary_folder.time())
    }

    fn lock(&self) -> MutexGuard<'_, Memory> {
        // Entries are inserted in one step, so the cache is valid even after a panic.
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Writes the index if a file was found damaged, so that the next process does not trust it.
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
    match delayed_names::if_listed(path, || own_metadata(path)) {
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
        let reason = format!("it contains artifact {}", header.content.short());
        Err(StoreError::damaged(path, reason))
    }
}
