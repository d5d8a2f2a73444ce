//! Where things lie in a store, and the marker that says which layout it is.
//!
//! ```text
//! DIR/format            `deaflow-store 2`
//! DIR/objects/ab/<digest>.h5   artifacts by the digest of their content
//! DIR/records/ab/<key>  what an action made
//! DIR/checkpoints/<key>/  what unfinished actions have come to
//! DIR/runs/             past runs: the last are roots; the memory behind "parameter changed"
//! DIR/logs/              what runs said, for people
//! DIR/memos/             answers that are dear to find and may be deleted
//! DIR/cluster/           what submitters and workers of a cluster leave for each other
//! DIR/remotes/            what was read of remotes: signed records, and notes on interrupted uploads; may be deleted
//! DIR/origins/ab/<key>  who has signed a record that was brought from a remote: to sign it again would be to vouch for it
//! DIR/pins/              artifacts that a collection keeps
//! DIR/lock-files/        where lock files of pipelines are: a collection keeps what they name
//! DIR/costs.jsonl        what stages have cost
//! DIR/removed.jsonl      what collections have removed, and when
//! DIR/index             stamps of files known to be sound; a cache
//! DIR/locks/            run lock, locks or claims of actions in flight, processes where locks are not seen by all
//! DIR/tmp/              files being written
//! DIR/quarantine/       damaged files, moved aside
//! ```

use std::fs;
use std::path::{Path, PathBuf};

use super::atomic;
use super::delayed_names;
use super::entries::{files_in, names_in};
use super::error::StoreError;
use super::locking;
use super::marker;
use deaflow_base::{ActionKey, ArtifactId, folder_of, kind_of};

const MARKER: &str = "format";

/// The folder of log files.
pub const LOGS: &str = "logs";

/// The folder of answers that are dear to find.
pub const MEMOS: &str = "memos";

/// The folder of what the submitters and workers of a cluster leave for each other.
pub const CLUSTER: &str = "cluster";

/// The folder of who has said what records say that were brought from other stores.
pub const ORIGINS: &str = "origins";

/// The folder of what was read of remotes.
pub const REMOTES: &str = "remotes";

/// The folders that every store has.
const FOLDERS: [&str; 6] = ["objects", "records", "runs", "locks/actions", "tmp", "quarantine"];

/// Those that are made when they are needed.
const LATER: [&str; 11] = [
    "checkpoints",
    "pins",
    "lock-files",
    "figures",
    LOGS,
    MEMOS,
    CLUSTER,
    REMOTES,
    ORIGINS,
    "locks/claims",
    "locks/processes",
];

/// The paths of one store.
#[derive(Clone, Debug)]
pub struct Layout {
    root: PathBuf,
}

impl Layout {
    /// Opens the folder as a store; an empty or absent folder becomes one.
    ///
    /// # Errors
    /// When the folder holds something else, a damaged store or one of an unknown version, something else stands in the place of a
    /// folder of the store, or one cannot be created.
    pub fn open(root: &Path) -> Result<Self, StoreError> {
        let layout = Self::of(root)?;
        if !Self::is_store(root) {
            layout.create()?;
        }
        layout.expect_late_names();
        // A marker that another machine has just made may be listed and not be seen.
        let looked = delayed_names::until_seen(|| match layout.look() {
            Err(StoreError::NotAStore { .. }) if layout.lists_marker() => Err(std::io::ErrorKind::NotFound.into()),
            looked => Ok(looked),
        });
        looked.map_err(StoreError::io("read", &layout.marker()))??;
        layout.make_folders()?;
        Ok(layout)
    }

    /// The paths of a folder that may be a store.
    ///
    /// # Errors
    /// When it is no folder, or its path is not UTF-8.
    pub fn of(root: &Path) -> Result<Self, StoreError> {
        let root = root.to_owned();
        match () {
            () if root.to_str().is_none() => Err(StoreError::PathNotUtf8 { path: root }),
            () if root.exists() && !root.is_dir() => Err(StoreError::NotAStore { path: root }),
            () => Ok(Self { root }),
        }
    }

    /// Whether the folder has a store's marker, or all else that every store has: its marker is lost then.
    pub fn is_store(root: &Path) -> bool {
        let layout = Self { root: root.to_owned() };
        fs::symlink_metadata(layout.marker()).is_ok() || layout.has_folders()
    }

    /// The folder of the store that a path lies in, if it lies in one; the path itself need not be there.
    pub fn around(path: &Path) -> Option<PathBuf> {
        let folder = fs::canonicalize(folder_of(path)).ok()?;
        let mut folders = folder.ancestors();
        let is_store = |folder: &&Path| marker::check(&folder.join(MARKER)).is_ok();
        folders.find(is_store).map(Path::to_owned)
    }

    /// Whether this is a store that may be written in. Nothing is touched.
    ///
    /// # Errors
    /// When it has no sound marker of this version, or something else stands in the place of a folder of it.
    pub fn look(&self) -> Result<(), StoreError> {
        let marker = self.marker();
        if fs::symlink_metadata(&marker).is_ok() {
            self.check_folders()?;
            return marker::check(&marker);
        }
        match self.has_folders() {
            true => self.check_folders().and(Err(StoreError::Marker {
                path: marker,
                reason: "it is not there".to_owned(),
            })),
            false => Err(StoreError::NotAStore {
                path: self.root.clone(),
            }),
        }
    }

    /// Makes the folders that every store has.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn make_folders(&self) -> Result<(), StoreError> {
        for folder in FOLDERS {
            let path = self.root.join(folder);
            if !path.is_dir() {
                delayed_names::make_folders(&path).map_err(StoreError::io("create", &path))?;
            }
        }
        Ok(())
    }

    /// Whether the folders are there without which a store is none.
    fn has_folders(&self) -> bool {
        [self.objects(), self.records(), self.action_locks()]
            .iter()
            .all(|folder| folder.is_dir())
    }

    /// Through a link, what is written or removed here would be so elsewhere.
    fn check_folders(&self) -> Result<(), StoreError> {
        let refuse = |path: PathBuf, wanted: &'static str| match fs::symlink_metadata(&path) {
            Ok(metadata) if kind_of(&metadata) != wanted => Err(StoreError::Foreign {
                found: kind_of(&metadata),
                path,
                wanted,
            }),
            _ => Ok(()),
        };
        self.own_folders().try_for_each(|folder| refuse(folder, "a folder"))?;
        let mut locks = [self.run_lock(), self.publish_lock()].into_iter();
        locks.try_for_each(|file| refuse(file, "a regular file"))
    }

    fn create(&self) -> Result<(), StoreError> {
        delayed_names::make_folders(&self.root).map_err(StoreError::io("create", &self.root))?;
        self.expect_late_names();
        // Its name must survive a crash of the machine as what is in it does.
        atomic::sync_folder(folder_of(&self.root))?;
        // A README and dot files may stand in a store's folder; a marker may have been left half-written.
        let expected = |name: &str| ["README", ".", MARKER].iter().any(|start| name.starts_with(start));
        for path in files_in(&self.root)? {
            if !expected(&path.file_name().unwrap_or_default().to_string_lossy()) {
                // Unless another process has just made it a store.
                return if self.marker().exists() || self.lists_marker() {
                    Ok(())
                } else {
                    Err(StoreError::NotAStore {
                        path: self.root.clone(),
                    })
                };
            }
        }
        let folder = tempfile::Builder::new().prefix("format-").tempdir_in(&self.root);
        let folder = folder.map_err(StoreError::io("write in", &self.root))?;
        marker::write(folder.path(), &self.marker())
    }

    /// Whether the folder lists a marker, which may be seen before it can be opened.
    fn lists_marker(&self) -> bool {
        let names = names_in(&self.root).unwrap_or_default();
        names.iter().any(|name| name == MARKER)
    }

    fn expect_late_names(&self) {
        if !locking::file_system(&self.root).1 {
            delayed_names::expect();
        }
    }

    /// The folders of a store, whether they are there or not.
    pub fn own_folders(&self) -> impl Iterator<Item = PathBuf> {
        let own = ["locks"].into_iter().chain(FOLDERS).chain(LATER);
        own.map(|folder| self.root.join(folder))
    }

    pub fn marker(&self) -> PathBuf {
        self.root.join(MARKER)
    }

    pub fn figures(&self) -> PathBuf {
        self.root.join("figures")
    }

    pub fn object(&self, digest: &ArtifactId) -> PathBuf {
        let name = digest.to_string();
        self.root.join("objects").join(&name[..2]).join(format!("{name}.h5"))
    }

    /// The artifact whose file this is by its place. A copy that somebody left beside it is not that artifact.
    pub fn artifact_at(&self, path: &Path) -> Option<ArtifactId> {
        let digest = path.file_stem()?.to_str()?.parse().ok()?;
        (self.object(&digest) == path).then_some(digest)
    }

    /// The action whose record this is by its place.
    pub fn action_at(&self, path: &Path) -> Option<ActionKey> {
        let key = path.file_name()?.to_str()?.parse().ok()?;
        (self.record(&key) == path).then_some(key)
    }

    pub fn objects(&self) -> PathBuf {
        self.root.join("objects")
    }

    pub fn record(&self, key: &ActionKey) -> PathBuf {
        let name = key.to_string();
        self.root.join("records").join(&name[..2]).join(name)
    }

    pub fn records(&self) -> PathBuf {
        self.root.join("records")
    }

    pub fn checkpoints(&self) -> PathBuf {
        self.root.join("checkpoints")
    }

    pub fn checkpoints_of(&self, key: &ActionKey) -> PathBuf {
        self.checkpoints().join(key.to_string())
    }

    pub fn runs(&self) -> PathBuf {
        self.root.join("runs")
    }

    pub fn pins(&self) -> PathBuf {
        self.root.join("pins")
    }

    pub fn lock_files(&self) -> PathBuf {
        self.root.join("lock-files")
    }

    pub fn costs(&self) -> PathBuf {
        self.root.join("costs.jsonl")
    }

    pub fn removed(&self) -> PathBuf {
        self.root.join("removed.jsonl")
    }

    pub fn run_lock(&self) -> PathBuf {
        self.root.join("locks/store")
    }

    pub fn publish_lock(&self) -> PathBuf {
        self.root.join("locks/publish")
    }

    pub fn action_locks(&self) -> PathBuf {
        self.root.join("locks/actions")
    }

    /// The lock of an action. Keys share 65,536 files, which stay: to make and remove a file for each chunk would cost more
    /// than to wait, now and then, for another.
    pub fn action_lock(&self, key: &ActionKey) -> PathBuf {
        self.action_locks().join(&key.to_string()[..4])
    }

    /// Claims on actions.
    pub fn claims(&self) -> PathBuf {
        self.root.join("locks/claims")
    }

    /// Who has the store open, where that is told by claims.
    pub fn processes(&self) -> PathBuf {
        self.root.join("locks/processes")
    }

    /// The stamps of files that are known to be sound, as one machine sees them: of `host`, where several share the store.
    pub fn index(&self, host: Option<&str>) -> PathBuf {
        let plain = |c: char| {
            if c.is_ascii_alphanumeric() || "-._".contains(c) {
                c
            } else {
                '_'
            }
        };
        match host {
            None => self.root.join("index"),
            Some(host) => self
                .root
                .join(format!("index-{}", host.chars().map(plain).collect::<String>())),
        }
    }

    pub fn temporary(&self) -> PathBuf {
        self.root.join("tmp")
    }

    pub fn quarantine(&self) -> PathBuf {
        self.root.join("quarantine")
    }

    pub fn root(&self) -> &Path {
        &self.root
    }
}
