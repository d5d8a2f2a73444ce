//! The public store: opens a store, and writes and finds artifacts.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use tempfile::{TempDir, TempPath};

use super::artifact::Artifact;
use super::atomic;
use super::delayed_names;
use super::entries::{files, is_file, is_folder};
use super::error::StoreError;
use super::header::Header;
use super::layout::Layout;
use super::listing::{self, Content};
use super::locking::LockingChoice;
use super::object::Object;
use super::provenance::Provenance;
use super::quarantine::{quarantine, read_twice};
use super::read::Access;
use super::session::StoreSession;
use super::stamp::Time;
use super::upstream::UpstreamLink;
use super::verified::Verified;
use super::write::{self, Part};
use deaflow_base::{ArtifactId, FileDigest, folder_of};

/// An open store. Cheap to clone; no garbage collection runs while it is open.
#[derive(Clone)]
pub struct Store {
    pub(super) layout: Layout,
    pub(super) verified: Arc<Verified>,
    pub(super) access: Access,
    pub(super) unsettled: Arc<Mutex<BTreeSet<PathBuf>>>,
    pub(super) session: Arc<StoreSession>,
    pub(super) upstream: Option<UpstreamLink>,
}

/// An artifact that has been written, or already existed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stored {
    /// The artifact.
    pub digest: ArtifactId,
    /// BLAKE3 digest of the file (after the user block).
    pub file_digest: FileDigest,
    /// Length of the file in bytes.
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
    /// Opens a store, creates it if there is none, and removes what dead processes left.
    ///
    /// # Errors
    /// If the folder is not a store or has an unsupported version, or the system reports an error.
    pub fn open(root: &Path) -> Result<Self, StoreError> {
        let layout = Layout::open(root)?;
        let session = StoreSession::shared(&layout)?;
        Ok(Self::with_session(layout, session))
    }

    fn with_session(layout: Layout, session: StoreSession) -> Self {
        let session = Arc::new(session);
        Self {
            verified: Arc::new(Verified::with_index(&layout, session.clone())),
            access: Access::Here,
            unsettled: Arc::default(),
            session,
            layout,
            upstream: None,
        }
    }

    /// Returns the time of the clock of the file system, which stamps its files; it may differ from that of this
    /// machine.
    #[must_use]
    pub fn now(&self) -> SystemTime {
        let since = |(seconds, nanoseconds): Time| {
            let seconds = u64::try_from(seconds).ok()?;
            SystemTime::UNIX_EPOCH.checked_add(Duration::new(seconds, u32::try_from(nanoseconds).ok()?))
        };
        let time = self.session.temporary_folder.time();
        time.and_then(since).unwrap_or_else(SystemTime::now)
    }

    /// Returns the locking method of this store, with the reason.
    #[must_use]
    pub fn locking(&self) -> &LockingChoice {
        &self.session.choice
    }

    /// Returns the same store, reading every artifact in another process: slower for large ones, but no file can crash
    /// this process.
    #[must_use]
    pub fn guarded(self) -> Self {
        Self {
            access: Access::Guarded,
            ..self
        }
    }

    /// Returns the same store, ignoring its index: all files are verified in full, and the index is written anew.
    #[must_use]
    pub fn without_index(self) -> Self {
        Self {
            verified: Arc::new(Verified::without_index(&self.layout, self.session.clone())),
            ..self
        }
    }

    /// Writes the index of verified files, so that the next process need not read them. It is a cache: errors are
    /// ignored.
    pub fn save_index(&self) {
        self.verified.keep();
    }

    /// Returns the folder of the store that contains a path, if any.
    #[must_use]
    pub fn around(path: &Path) -> Option<PathBuf> {
        Layout::around(path)
    }

    /// Whether a folder is a store, possibly a damaged one.
    #[must_use]
    pub fn is_at(root: &Path) -> bool {
        Layout::is_store(root)
    }

    /// Checks that a store can be at `root`: a folder, or nothing yet.
    ///
    /// # Errors
    /// If a file has this name, or the path is not UTF-8.
    pub fn check_folder(root: &Path) -> Result<(), StoreError> {
        Layout::of(root).map(drop)
    }

    /// Opens a store that must exist, so that reading from a mistyped folder does not create one.
    ///
    /// # Errors
    /// If there is none, or as [`Store::open`].
    pub fn open_existing(root: &Path) -> Result<Self, StoreError> {
        if Layout::is_store(root) {
            Self::open(root)
        } else {
            Err(StoreError::NoStore { path: root.to_owned() })
        }
    }

    /// Opens a store that must exist, for reading over a long time: a garbage collection may run meanwhile and remove
    /// artifacts.
    ///
    /// # Errors
    /// If there is none, or as [`Store::open`].
    pub fn open_unlocked(root: &Path) -> Result<Self, StoreError> {
        if !Layout::is_store(root) {
            return Err(StoreError::NoStore { path: root.to_owned() });
        }
        let layout = Layout::open(root)?;
        let session = StoreSession::aside(&layout);
        Ok(Self::with_session(layout, session))
    }

    /// Opens a store that must exist with exclusive access, for garbage collection and repair.
    ///
    /// # Errors
    /// If there is none, another process has it open, or as [`Store::open`].
    pub fn open_exclusive(root: &Path) -> Result<Self, StoreError> {
        if !Layout::is_store(root) {
            return Err(StoreError::NoStore { path: root.to_owned() });
        }
        let layout = Layout::open(root)?;
        let session = StoreSession::alone(&layout)?;
        Ok(Self::with_session(layout, session))
    }

    /// Releases the claims and the heartbeat of this process. For a process that ends without dropping its stores; it
    /// must not write any more.
    pub fn leave(&self) {
        self.session.leave();
    }

    /// Puts the present stamp of an artifact into the index, as if its bytes had changed without the file system
    /// noticing. For tests, also in other crates.
    #[doc(hidden)]
    pub fn trust_current_file(&self, digest: &ArtifactId) {
        Verified::believe(&self.layout.index(None), &self.layout.object(digest), digest);
    }

    /// Returns the folder of the store.
    #[must_use]
    pub fn root(&self) -> &Path {
        self.layout.root()
    }

    /// Writes an object unless the store has it already. A damaged file in its place is moved to quarantine.
    ///
    /// # Errors
    /// If the content is not valid for an artifact, a chunk of a manifest is missing, or the system reports an error
    /// (disk full).
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

    /// Opens an artifact and verifies every byte of its file. If it is not here, it is downloaded from the upstream
    /// store.
    ///
    /// # Errors
    /// If it is missing or damaged.
    pub fn artifact(&self, digest: &ArtifactId) -> Result<Artifact, StoreError> {
        match self.artifact_here(digest) {
            Err(error) if error.is_damage() && self.upstream.is_some() && self.fetch(digest)? => {
                self.artifact_here(digest)
            }
            found => found,
        }
    }

    fn artifact_here(&self, digest: &ArtifactId) -> Result<Artifact, StoreError> {
        Artifact::load(self.access, self.layout.object(digest), *digest, self.verified.clone())
    }

    /// Returns the artifacts whose digests start with these hexadecimal digits, in order.
    ///
    /// # Errors
    /// If the system reports an error.
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

    /// Gives a finished file its name, without replacing anything: if several processes write the same content, the
    /// first succeeds and the others use its file. Such files differ only in their provenance.
    pub(super) fn publish(&self, temporary: &Path, header: Header) -> Result<Stored, StoreError> {
        let target = self.layout.object(&header.content);
        self.clear_folder(folder_of(&target))?;
        let start = Instant::now();
        loop {
            match read_twice(&target, || self.verified.verify(&target, &header.content)) {
                Ok(header) => return Ok(header.into()),
                Err(StoreError::Missing { .. }) if atomic::link(temporary, &target)? => {
                    self.verified.remember(&target, header);
                    return Ok(header.into());
                }
                // A file exists that is not visible yet.
                Err(StoreError::Missing { .. }) if start.elapsed() < delayed_names::LATEST => {
                    std::thread::sleep(delayed_names::PAUSE)
                }
                Err(error) if error.is_damage() => {
                    self.quarantine(&target)?;
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// Moves a file to quarantine. Does nothing if there is none.
    pub(super) fn quarantine(&self, path: &Path) -> Result<Option<PathBuf>, StoreError> {
        quarantine(&self.layout, path)
    }

    /// Moves whatever is at the path of a folder and is not a folder to quarantine: writing through a link would write
    /// elsewhere.
    pub(super) fn clear_folder(&self, folder: &Path) -> Result<(), StoreError> {
        if !is_folder(folder) {
            self.quarantine(folder)?;
        }
        Ok(())
    }

    /// Moves whatever is at the path of a file and is not a regular file to quarantine.
    pub(super) fn clear_file(&self, path: &Path) -> Result<(), StoreError> {
        if !is_file(path) {
            self.quarantine(path)?;
        }
        Ok(())
    }

    /// Returns the chunks of a manifest and their concatenated datasets. Chunks are opened only if their structure is
    /// not known.
    fn chunks_of(&self, object: &Object) -> Result<(Vec<Part>, Vec<Content>), StoreError> {
        let mut parts = Vec::with_capacity(object.parts.len());
        for digest in &object.parts {
            let structure = self.verified.structure(&self.layout.object(digest), digest)?;
            if !structure.parts.is_empty() {
                return Err(StoreError::Parts {
                    digest: *digest,
                    reason: "it is a manifest".into(),
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

    /// Returns the folders of records that are not synced yet: a crash of the machine may lose names in them.
    pub(super) fn unsettled(&self) -> MutexGuard<'_, BTreeSet<PathBuf>> {
        // Folders are added one by one, so the set is valid even after a panic.
        self.unsettled.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Creates a folder for a file being written, removed on drop. Its name is random: processes in different
    /// containers may have the same process ID.
    pub(super) fn temporary(&self) -> Result<TempDir, StoreError> {
        let folder = self.layout.temporary();
        let failed = StoreError::io("write in", &folder);
        self.session
            .temporary_folder
            .folder()
            .and_then(tempfile::tempdir_in)
            .map_err(failed)
    }

    /// Creates an empty file to be written and moved into place; removed on drop if it was not moved.
    pub(super) fn temporary_file(&self) -> Result<TempPath, StoreError> {
        let folder = self.layout.temporary();
        let failed = StoreError::io("write in", &folder);
        let file = self.session.temporary_folder.file().map_err(failed)?;
        Ok(file.into_temp_path())
    }
}
