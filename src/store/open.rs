//! The store as its users hold it: opening, putting and finding artifacts.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use tempfile::{TempDir, TempPath};

use super::artifact::Artifact;
use super::atomic;
use super::entries::{files, is_file, is_folder};
use super::error::StoreError;
use super::header::Header;
use super::hold::Hold;
use super::late;
use super::layout::Layout;
use super::listing::{self, Content};
use super::locking::Choice;
use super::object::Object;
use super::provenance::Provenance;
use super::quarantine::quarantine;
use super::read::Access;
use super::stamp::Time;
use super::upstream::Upward;
use super::verified::Verified;
use super::write::{self, Part};
use deaflow_base::{ArtifactId, FileDigest, folder_of};

/// An open store. Cheap to clone; while one is open, no collection runs.
#[derive(Clone)]
pub struct Store {
    pub(super) layout: Layout,
    pub(super) verified: Arc<Verified>,
    pub(super) access: Access,
    pub(super) unsettled: Arc<Mutex<BTreeSet<PathBuf>>>,
    pub(super) hold: Arc<Hold>,
    pub(super) upward: Option<Upward>,
}

/// What has been put.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stored {
    /// The artifact.
    pub digest: ArtifactId,
    /// BLAKE3 of its file as written (after the user block).
    pub file_digest: FileDigest,
    /// Length of its file in bytes.
    pub size: u64,
}

impl From<Header> for Stored {
    fn from(header: Header) -> Self {
        Self {
            digest: header.content,
            file_digest: header.file,
            size: header.size,
        }
    }
}

impl Store {
    /// Opens a folder as a store, creating it where there is none, and clears what dead processes left.
    ///
    /// # Errors
    /// When the folder is something else or of an unknown version, or the system refuses.
    pub fn open(root: &Path) -> Result<Self, StoreError> {
        let layout = Layout::open(root)?;
        let hold = Hold::shared(&layout)?;
        Ok(Self::held(layout, hold))
    }

    fn held(layout: Layout, hold: Hold) -> Self {
        let hold = Arc::new(hold);
        Self {
            verified: Arc::new(Verified::with_index(&layout, hold.clone())),
            access: Access::Here,
            unsettled: Arc::default(),
            hold,
            layout,
            upward: None,
        }
    }

    /// The time by the clock of the store's file system, by which its files have their ages; that of this machine may be another.
    #[must_use]
    pub fn now(&self) -> SystemTime {
        let since = |(seconds, nanoseconds): Time| {
            let seconds = u64::try_from(seconds).ok()?;
            SystemTime::UNIX_EPOCH.checked_add(Duration::new(seconds, u32::try_from(nanoseconds).ok()?))
        };
        let time = self.hold.workbench.time();
        time.and_then(since).unwrap_or_else(SystemTime::now)
    }

    /// How processes keep out of each other's way here, and why so.
    #[must_use]
    pub fn locking(&self) -> &Choice {
        &self.hold.choice
    }

    /// The same store, whose artifacts are all read in another process, whoever wrote them: slower where they are large, and
    /// no file can bring this process down.
    #[must_use]
    pub fn guarded(self) -> Self {
        Self {
            access: Access::Guarded,
            ..self
        }
    }

    /// The same store, taking nobody's word: whatever is looked at is verified in full, whatever its index says. The index
    /// is made anew of what is found.
    #[must_use]
    pub fn without_trust(self) -> Self {
        Self {
            verified: Arc::new(Verified::without_trust(&self.layout, self.hold.clone())),
            ..self
        }
    }

    /// Writes down which files are known to be sound, so that the next process need not read them. A cache: where it cannot
    /// be written, nothing is lost but time.
    pub fn keep_index(&self) {
        self.verified.keep();
    }

    /// The folder of the store that a path lies in, if it lies in one: nobody else writes there.
    #[must_use]
    pub fn around(path: &Path) -> Option<PathBuf> {
        Layout::around(path)
    }

    /// Whether a folder is a store, be it a damaged one.
    #[must_use]
    pub fn is_at(root: &Path) -> bool {
        Layout::is_store(root)
    }

    /// Opens a store that must be there already: to look into a mistyped folder must not make a store of it.
    ///
    /// # Errors
    /// When there is none, or as [`Store::open`].
    pub fn open_existing(root: &Path) -> Result<Self, StoreError> {
        if Layout::is_store(root) {
            Self::open(root)
        } else {
            Err(StoreError::NoStore { path: root.to_owned() })
        }
    }

    /// Opens a store that must be there already, to look into it for long without being in the way: a collection may run meanwhile, and
    /// what it removes is then not found.
    ///
    /// # Errors
    /// When there is none, or as [`Store::open`].
    pub fn open_aside(root: &Path) -> Result<Self, StoreError> {
        if !Layout::is_store(root) {
            return Err(StoreError::NoStore { path: root.to_owned() });
        }
        let layout = Layout::open(root)?;
        let hold = Hold::aside(&layout);
        Ok(Self::held(layout, hold))
    }

    /// Opens a store that must be there already for one process alone, to collect in it.
    ///
    /// # Errors
    /// When there is none, another process has it open, or as [`Store::open`].
    pub fn open_alone(root: &Path) -> Result<Self, StoreError> {
        if !Layout::is_store(root) {
            return Err(StoreError::NoStore { path: root.to_owned() });
        }
        let layout = Layout::open(root)?;
        let hold = Hold::alone(&layout)?;
        Ok(Self::held(layout, hold))
    }

    /// Gives up what others would wait for: claims, and the sign that this process lives. For a process that is about to end without
    /// letting go of what it has; it must not write any more.
    pub fn leave(&self) {
        self.hold.leave();
    }

    /// Has the index believe the file of an artifact as it is now, as if bytes had changed beneath the file system.
    /// For tests, here and in other rooms.
    #[doc(hidden)]
    pub fn believe(&self, digest: &ArtifactId) {
        Verified::believe(&self.layout.index(None), &self.layout.object(digest), digest);
    }

    /// Its folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        self.layout.root()
    }

    /// Writes an object, or finds that it is there already. A damaged file in its place is quarantined.
    ///
    /// # Errors
    /// When the content cannot be an artifact, a chunk of a manifest is missing, or the system refuses (disk full).
    pub fn put(&self, object: &Object, provenance: &Provenance) -> Result<Stored, StoreError> {
        let digest = object.digest()?;
        if let Some(stored) = self.existing(&digest)? {
            return Ok(stored);
        }
        let (parts, shown) = self.chunks_of(object)?;
        let listing = listing::of_object(object);
        let contents = if parts.is_empty() { &listing.contents } else { &shown };
        let temporary = self.temporary_file()?;
        write::write(&temporary, object, &parts, contents, provenance)
            .map_err(StoreError::hdf5("write", &temporary))?;
        let header = Header::write(&temporary, digest)?;
        let stored = self.publish(&temporary, header)?;
        self.verified.describe(&digest, listing, object.parts.clone());
        Ok(stored)
    }

    /// Opens an artifact, verifying every byte of its file. One that is not here is brought from the store behind this one.
    ///
    /// # Errors
    /// When it is missing or damaged.
    pub fn artifact(&self, digest: &ArtifactId) -> Result<Artifact, StoreError> {
        match self.artifact_here(digest) {
            Err(error) if error.is_damage() && self.upward.is_some() && self.fetch(digest)? => {
                self.artifact_here(digest)
            }
            found => found,
        }
    }

    fn artifact_here(&self, digest: &ArtifactId) -> Result<Artifact, StoreError> {
        Artifact::load(self.access, self.layout.object(digest), *digest, self.verified.clone())
    }

    /// The artifacts whose digests begin with these hexadecimal digits, in order.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn find(&self, prefix: &str) -> Result<Vec<ArtifactId>, StoreError> {
        let mut found = Vec::new();
        for path in files(&self.layout.objects())? {
            found.extend(
                self.layout
                    .artifact_at(&path)
                    .filter(|digest| digest.to_string().starts_with(prefix)),
            );
        }
        found.sort_unstable();
        Ok(found)
    }

    fn existing(&self, digest: &ArtifactId) -> Result<Option<Stored>, StoreError> {
        match self.verified.verify(&self.layout.object(digest), digest) {
            Ok(header) => Ok(Some(header.into())),
            Err(StoreError::Missing { .. }) => Ok(None),
            Err(error) if error.is_damage() => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Its name is what makes the file visible, and it replaces nothing: of several who put the same content the first succeeds, and the
    /// others find it. Files of one content differ in their provenance.
    pub(super) fn publish(&self, temporary: &Path, header: Header) -> Result<Stored, StoreError> {
        let target = self.layout.object(&header.content);
        self.clear_folder(folder_of(&target))?;
        let start = Instant::now();
        loop {
            match self.verified.verify(&target, &header.content) {
                Ok(header) => return Ok(header.into()),
                Err(StoreError::Missing { .. }) if atomic::link(temporary, &target)? => {
                    self.verified.remember(&target, header);
                    return Ok(header.into());
                }
                // Something is there that cannot be seen yet.
                Err(StoreError::Missing { .. }) if start.elapsed() < late::LATEST => std::thread::sleep(late::PAUSE),
                Err(error) if error.is_damage() => {
                    self.quarantine(&target)?;
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// Moves a file aside, keeping it for whoever wants to know what happened. Nothing happens where there is none.
    pub(super) fn quarantine(&self, path: &Path) -> Result<Option<PathBuf>, StoreError> {
        quarantine(&self.layout, path)
    }

    /// Moves aside whatever stands in the place of a folder of ours and is none: through a link, what is written there would be
    /// written elsewhere.
    pub(super) fn clear_folder(&self, folder: &Path) -> Result<(), StoreError> {
        if !is_folder(folder) {
            self.quarantine(folder)?;
        }
        Ok(())
    }

    /// Moves aside whatever stands in the place of a file of ours and is none.
    pub(super) fn clear_file(&self, path: &Path) -> Result<(), StoreError> {
        if !is_file(path) {
            self.quarantine(path)?;
        }
        Ok(())
    }

    /// The chunks of a manifest, which need not be opened where it is known what stands in them, and their datasets laid end to
    /// end.
    fn chunks_of(&self, object: &Object) -> Result<(Vec<Part>, Vec<Content>), StoreError> {
        let mut parts = Vec::with_capacity(object.parts.len());
        for digest in &object.parts {
            let structure = self.verified.structure(&self.layout.object(digest), digest)?;
            if !structure.parts.is_empty() {
                return Err(StoreError::Parts {
                    digest: *digest,
                    reason: "it is a manifest itself".into(),
                });
            }
            parts.push(Part {
                digest: *digest,
                listing: structure.listing,
            });
        }
        let shown = listing::concatenate(parts.iter().map(|part| (part.digest, part.listing.contents.as_slice())))?;
        Ok((parts, shown))
    }

    /// Folders of records whose names a crash of the machine may lose.
    pub(super) fn unsettled(&self) -> MutexGuard<'_, BTreeSet<PathBuf>> {
        // Folders are added one by one: a panic elsewhere leaves a set that is right.
        self.unsettled.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A folder for a file being written, removed when dropped. Its name is random: processes in different containers
    /// may have the same number.
    pub(super) fn temporary(&self) -> Result<TempDir, StoreError> {
        let folder = self.layout.temporary();
        let refused = StoreError::io("write in", &folder);
        self.hold
            .workbench
            .folder()
            .and_then(tempfile::tempdir_in)
            .map_err(refused)
    }

    /// An empty file to be written and moved into place, removed when dropped before that.
    pub(super) fn temporary_file(&self) -> Result<TempPath, StoreError> {
        let folder = self.layout.temporary();
        let refused = StoreError::io("write in", &folder);
        let file = self.hold.workbench.file().map_err(refused)?;
        Ok(file.into_temp_path())
    }
}
