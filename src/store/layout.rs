//! Where things lie in a store, and the marker that says which layout it is.
//!
//! ```text
//! DIR/format            `deaflow-store 2`
//! DIR/objects/ab/<digest>.h5   artifacts by the digest of their content
//! DIR/records/ab/<key>  what an action made
//! DIR/checkpoints/<key>/  what unfinished actions have come to
//! DIR/runs/             the last runs: roots, and the memory behind "parameter changed"
//! DIR/pins/              artifacts that a collection keeps
//! DIR/lock-files/        where lock files of pipelines are: a collection keeps what they name
//! DIR/costs.jsonl        what stages have cost
//! DIR/index             stamps of files known to be sound; a cache
//! DIR/locks/            run lock, publishing lock, locks of actions in flight
//! DIR/tmp/              files being written
//! DIR/quarantine/       damaged files, moved aside
//! ```

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::atomic;
use super::error::StoreError;
use crate::base::{ActionKey, ArtifactId, read_bounded};

/// The line in the marker file.
pub const FORMAT: &str = "deaflow-store 2";

const MARKER: &str = "format";

const FOLDERS: [&str; 6] = ["objects", "records", "runs", "locks/actions", "tmp", "quarantine"];

/// The paths of one store.
#[derive(Clone, Debug)]
pub struct Layout {
    root: PathBuf,
}

impl Layout {
    /// Opens the folder as a store; an empty or absent folder becomes one.
    ///
    /// # Errors
    /// When the folder holds something else, a store of an unknown version, or cannot be created.
    pub fn open(root: &Path) -> Result<Self, StoreError> {
        let layout = Self { root: root.to_owned() };
        if root.to_str().is_none() {
            return Err(StoreError::PathNotUtf8 { path: layout.root });
        }
        if root.exists() && !root.is_dir() {
            return Err(StoreError::NotAStore { path: layout.root });
        }
        let marker = root.join(MARKER);
        if !marker.exists() {
            layout.create(&marker)?;
        }
        let bytes = read_bounded(&marker, 4096).map_err(|error| match error.kind() {
            ErrorKind::InvalidInput | ErrorKind::FileTooLarge => StoreError::Format {
                path: marker.clone(),
                found: error.to_string(),
                known: FORMAT,
            },
            _ => StoreError::io("read", &marker)(error),
        })?;
        let text = String::from_utf8_lossy(&bytes);
        if text.trim_end() != FORMAT {
            return Err(StoreError::Format {
                path: marker,
                found: text.trim_end().chars().take(80).collect(),
                known: FORMAT,
            });
        }
        for folder in FOLDERS {
            let path = root.join(folder);
            if !path.is_dir() {
                fs::create_dir_all(&path).map_err(StoreError::io("create", &path))?;
            }
        }
        Ok(layout)
    }

    /// Whether the folder has a store's marker.
    pub fn is_store(root: &Path) -> bool {
        root.join(MARKER).exists()
    }

    fn create(&self, marker: &Path) -> Result<(), StoreError> {
        fs::create_dir_all(&self.root).map_err(StoreError::io("create", &self.root))?;
        // A README and dot files may stand in a store's folder; a marker may have been left half-written.
        let expected = |name: &str| ["README", ".", MARKER].iter().any(|start| name.starts_with(start));
        for path in files_in(&self.root)? {
            if !expected(&path.file_name().unwrap_or_default().to_string_lossy()) {
                // Unless another process has just made it a store.
                return if marker.exists() {
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
        atomic::write(&folder.path().join("format"), marker, format!("{FORMAT}\n").as_bytes())
    }

    pub fn object(&self, digest: &ArtifactId) -> PathBuf {
        let name = digest.to_string();
        self.root.join("objects").join(&name[..2]).join(format!("{name}.h5"))
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

    pub fn index(&self) -> PathBuf {
        self.root.join("index")
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

/// Everything in a folder that need not be there, in order. Only where there is nothing at all of its name there is nothing in
/// it: a folder that cannot be read, or something else in its place, may hide what was in it.
pub fn files_in_optional(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    match fs::symlink_metadata(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        _ => files_in(folder),
    }
}

/// Whether a name is one of those that file systems and their viewers leave everywhere.
pub fn is_hidden(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

/// Everything two levels down, in order.
pub fn files(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut out = Vec::new();
    for path in files_in(folder)? {
        if path.is_dir() {
            out.extend(files_in(&path)?);
        } else {
            out.push(path);
        }
    }
    Ok(out)
}

/// Everything in a folder, in order.
pub fn files_in(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut out = Vec::new();
    for entry in fs::read_dir(folder).map_err(StoreError::io("read", folder))? {
        out.push(entry.map_err(StoreError::io("read", folder))?.path());
    }
    out.sort_unstable();
    Ok(out)
}
