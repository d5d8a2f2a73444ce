//! Where a process writes files before they are put in place: a folder of its own in `tmp`, so that what another left
//! can be told from what another is writing.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::{Builder, NamedTempFile, TempDir};

use super::delayed_names;
use super::entries::TEMPORARY;
use super::stamp::{Time, file_system_time, machine_time};
use deaflow_base::temporary_file;

/// The folder of a process, created on first use and removed on drop.
pub struct TemporaryFolder {
    folder: PathBuf,
    /// The name of the process, if it has one.
    name: Option<String>,
    /// Whether it is on a local file system.
    is_local: bool,
    own: Mutex<Option<TempDir>>,
}

impl TemporaryFolder {
    /// Creates it in the folder `tmp` of a store.
    pub fn new(folder: &Path, name: Option<&str>, is_local: bool) -> Self {
        Self {
            folder: folder.to_owned(),
            name: name.map(str::to_owned),
            is_local,
            own: Mutex::default(),
        }
    }

    /// Returns the folder, and creates it if needed.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn folder(&self) -> io::Result<PathBuf> {
        // The value is valid even after a panic.
        let mut own = self.own.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(folder) = own.as_ref().filter(|folder| folder.path().is_dir()) {
            return Ok(folder.path().to_owned());
        }
        let make = || match &self.name {
            None => Builder::new().prefix(TEMPORARY).tempdir_in(&self.folder),
            Some(name) => Builder::new()
                .prefix(&format!("{TEMPORARY}{name}"))
                .rand_bytes(0)
                .tempdir_in(&self.folder),
        };
        let made = delayed_names::until_seen(make)?;
        Ok(own.insert(made).path().to_owned())
    }

    /// Whether this is the folder of this process.
    pub fn is_own(&self, path: &Path) -> bool {
        let own = self.own.lock().unwrap_or_else(PoisonError::into_inner);
        own.as_ref().is_some_and(|own| own.path() == path)
    }

    /// Creates an empty file, removed on drop unless it has been moved.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn file(&self) -> io::Result<NamedTempFile> {
        temporary_file(&self.folder()?)
    }

    /// The time by the clock of the file system, which is this machine's where the disk is: nothing is written to know
    /// it then.
    pub fn time(&self) -> Option<Time> {
        match self.is_local {
            true => Some(machine_time()),
            false => file_system_time(&self.folder().ok()?),
        }
    }
}

/// Returns the name of the process of a folder in `tmp`.
pub fn process_of(folder: &Path) -> Option<&str> {
    folder.file_name()?.to_str()?.strip_prefix(TEMPORARY)
}
