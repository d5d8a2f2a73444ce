//! The folders and files of a store.
//!
//! ```text
//! DIR/format            `deaflow-store 2`
//! DIR/objects/ab/<digest>.h5   artifacts by the digest of their content
//! DIR/records/ab/<key>  records of actions
//! DIR/checkpoints/<key>/  checkpoints of unfinished actions
//! DIR/runs/             history of runs
//! DIR/logs/              log files of runs
//! DIR/memos/             cached results; may be deleted
//! DIR/cluster/           notes between submitters and workers of a cluster
//! DIR/remotes/            cached records of remotes, and interrupted uploads; may be deleted
//! DIR/origins/ab/<key>  who has signed a record that was downloaded from a remote
//! DIR/pins/              artifacts that garbage collection keeps
//! DIR/lock-files/        paths of lock files, whose artifacts garbage collection keeps
//! DIR/costs.jsonl        costs of stages
//! DIR/removed.jsonl      removed artifacts
//! DIR/index             stamps of verified files; a cache
//! DIR/locks/            run lock, locks or claims of running actions, and processes if claims are used
//! DIR/tmp/              files being written
//! DIR/quarantine/       damaged files
//! ```

use std::fs;
use std::path::{Path, PathBuf};

use super::atomic;
use super::delayed_names;
use super::entries::{files_in, names_in};
use super::error::StoreError;
use super::file_system::file_system;
use super::marker;
use deaflow_base::{ActionKey, ArtifactId, TemporaryOutput, folder_of, kind_of};

const MARKER: &str = "format";

/// The folder of log files.
pub const LOGS: &str = "logs";

/// The folder of cached results.
pub const MEMOS: &str = "memos";

/// The folder of notes between submitters and workers of a cluster.
pub const CLUSTER: &str = "cluster";

/// The folder of the origins of downloaded records.
pub const ORIGINS: &str = "origins";

/// The folder of cached records of remotes.
pub const REMOTES: &str = "remotes";

/// The folders that every store has.
const FOLDERS: [&str; 6] = ["objects", "records", "runs", "locks/actions", "tmp", "quarantine"];

/// Folders that are created when they are needed.
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
    /// Opens a store; creates one in an empty or missing folder.
    ///
    /// # Errors
    /// If the folder holds something else, a damaged store or one of an unknown version, something else stands in the
    /// place of a folder of the store, or one cannot be created.
    pub fn open(root: &Path) -> Result<Self, StoreError> {
        let layout = Self::of(root)?;
        if !Self::is_store(root) {
            layout.create()?;
        }
        layout.expect_late_names();
        // A marker that another machine has just written may be listed before it is visible.
        let looked = delayed_names::until_seen(|| match layout.look() {
            Err(StoreError::NotAStore { .. }) if layout.lists_marker() => Err(std::io::ErrorKind::NotFound.into()),
            looked => Ok(looked),
        });
        looked.map_err(StoreError::io("read", &layout.marker()))??;
        layout.make_folders()?;
        Ok(layout)
    }

    /// Returns the paths of a folder that may be a store.
    ///
    /// # Errors
    /// If it is not a folder, or its path is not UTF-8.
    pub fn of(root: &Path) -> Result<Self, StoreError> {
        let root = root.to_owned();
        // Temporary files have absolute paths.
        let whole = std::path::absolute(&root).unwrap_or_else(|_| root.clone());
        match () {
            () if whole.to_str().is_none() => Err(StoreError::PathNotUtf8 { path: whole }),
            () if root.exists() && !root.is_dir() => Err(StoreError::NotAStore { path: root }),
            () => Ok(Self { root }),
        }
    }

    /// Whether the folder has the marker of a store, or the folders of a store whose marker is lost.
    pub fn is_store(root: &Path) -> bool {
        let layout = Self { root: root.to_owned() };
        fs::symlink_metadata(layout.marker()).is_ok() || layout.has_folders()
    }

    /// Returns the folder of the store that contains a path, if any; the path itself need not exist.
    pub fn around(path: &Path) -> Option<PathBuf> {
        let folder = fs::canonicalize(folder_of(path)).ok()?;
        let mut folders = folder.ancestors();
        let is_store = |folder: &&Path| marker::check(&folder.join(MARKER)).is_ok();
        folders.find(is_store).map(Path::to_owned)
    }

    /// Checks that this is a store, without changing it.
    ///
    /// # Errors
    /// If it has no sound marker of this version, or something else stands in the place of a folder of it.
    pub fn look(&self) -> Result<(), StoreError> {
        let marker = self.marker();
        if fs::symlink_metadata(&marker).is_ok() {
            self.check_folders()?;
            return marker::check(&marker);
        }
        match self.has_folders() {
            true => self.check_folders().and(Err(StoreError::Marker {
                path: marker,
                reason: "it is missing".to_owned(),
            })),
            false => Err(StoreError::NotAStore {
                path: self.root.clone(),
            }),
        }
    }

    /// Creates the folders that every store has.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn make_folders(&self) -> Result<(), StoreError> {
        for folder in FOLDERS {
            let path = self.root.join(folder);
            if !path.is_dir() {
                delayed_names::make_folders(&path).map_err(StoreError::io("create", &path))?;
            }
        }
        Ok(())
    }

    /// Whether the folders exist that every store has.
    fn has_folders(&self) -> bool {
        [self.objects(), self.records(), self.action_locks()]
            .iter()
            .all(|folder| folder.is_dir())
    }

    /// Checks that the folders and locks are not links, which would lead elsewhere.
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
        // A crash of the machine must not lose its name.
        atomic::sync_folder(folder_of(&self.root))?;
        // A README and dot files are allowed; a marker may have been left incomplete.
        let expected = |name: &str| ["README", ".", MARKER].iter().any(|start| name.starts_with(start));
        for path in files_in(&self.root)? {
            if !expected(&path.file_name().unwrap_or_default().to_string_lossy()) {
                // Another process may have just created the store.
                return if self.marker().exists() || self.lists_marker() {
                    Ok(())
                } else {
                    Err(StoreError::NotAStore {
                        path: self.root.clone(),
                    })
                };
            }
        }
        let folder = TemporaryOutput::inside(&self.root);
        let folder = folder.map_err(StoreError::io("write in", &self.root))?;
        marker::write(folder.path(), &self.marker())
    }

    /// Whether the folder lists a marker, which may be listed before it can be opened.
    fn lists_marker(&self) -> bool {
        let names = names_in(&self.root).unwrap_or_default();
        names.iter().any(|name| name == MARKER)
    }

    fn expect_late_names(&self) {
        if !file_system(&self.root).1 {
            delayed_names::expect();
        }
    }

    /// Returns the folders of a store, whether they exist or not.
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

    /// Returns the artifact of a file by its path. A copy under another path is not an artifact.
    pub fn artifact_at(&self, path: &Path) -> Option<ArtifactId> {
        let digest = path.file_stem()?.to_str()?.parse().ok()?;
        (self.object(&digest) == path).then_some(digest)
    }

    /// Returns the action of a record by its path.
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

    /// The lock of an action. Keys share 65,536 files, which stay: to make and remove a file for each chunk would cost
    /// more than to wait, now and then, for another.
    pub fn action_lock(&self, key: &ActionKey) -> PathBuf {
        self.action_locks().join(&key.to_string()[..4])
    }

    /// Returns the folder of claims on actions.
    pub fn claims(&self) -> PathBuf {
        self.root.join("locks/claims")
    }

    /// Returns the folder of the processes that have the store open, if claims are used.
    pub fn processes(&self) -> PathBuf {
        self.root.join("locks/processes")
    }

    /// The stamps of files that are known to be sound, as one machine sees them: of `host`, where several share the
    /// store.
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
