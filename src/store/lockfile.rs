//! Lock files of pipelines: the key and the artifact of every stage, with which later runs are compared.
//!
//! A lock file is next to its pipeline, not in the store. The store knows the paths of the lock files that were written
//! with it: garbage collection keeps their artifacts.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::atomic;
use super::entries::{files_in_optional, is_hidden};
use super::error::StoreError;
use super::open::Store;
use deaflow_base::{ActionKey, ArtifactId, Digest, Document, InputError, Node, OutputFile, ParseDigestError, read_own};

const WHAT: &str = "a lock file";

/// Maximum length of a path, bytes.
const MAX_PATH: u64 = 64 << 10;

/// The keys and artifacts of a pipeline.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LockFile {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Architecture, operating system and processor that made it.
    pub target: String,
    /// Every stage by its name.
    pub stages: BTreeMap<String, LockedStage>,
}

/// Key and artifact of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LockedStage {
    /// Its action key.
    pub key: ActionKey,
    /// Its artifact.
    pub artifact: ArtifactId,
}

impl LockFile {
    /// Returns the path of the lock file of a pipeline: `quickstart.yaml.lock` for `quickstart.yaml`. The extension is
    /// kept, so that `a.yaml` and `a.yml` have different lock files.
    #[must_use]
    pub fn path_for(pipeline: &Path) -> PathBuf {
        let mut name = pipeline.as_os_str().to_owned();
        name.push(".lock");
        PathBuf::from(name)
    }

    /// Reads a lock file.
    ///
    /// # Errors
    /// If it cannot be read or is not valid, with the position.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let document = Document::load(path)?;
        let map = document
            .root
            .fields(WHAT, &["version", "pipeline", "target", "stages"])?;
        let version = map.required(WHAT, "version")?;
        if version.integer("version", 0, u64::MAX)? != 1 {
            return Err(version.error(format!(
                "`version` is {}: this deaflow reads version 1",
                version.found()
            )));
        }
        let entries = map.required(WHAT, "stages")?.entries("stages")?;
        let stages = entries.iter().map(|(name, stage)| {
            let name = name.text("a stage's name")?;
            let stage = stage.fields("a locked stage", &["key", "artifact"])?;
            let locked = LockedStage {
                key: digest(stage.required("a locked stage", "key")?, "key")?,
                artifact: digest(stage.required("a locked stage", "artifact")?, "artifact")?,
            };
            Ok((name.to_owned(), locked))
        });
        Ok(Self {
            pipeline: map.required(WHAT, "pipeline")?.text("pipeline")?.to_owned(),
            target: map.required(WHAT, "target")?.text("target")?.to_owned(),
            stages: stages.collect::<Result<_, InputError>>()?,
        })
    }

    /// Writes the file. [`Store::remember_lock_file`] registers its path.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn write(&self, path: &Path) -> Result<(), StoreError> {
        let output = OutputFile::new(path)?;
        output.write(self.text().as_bytes())?;
        atomic::sync_folder(output.folder())
    }

    /// Returns the content of the file.
    #[must_use]
    pub fn text(&self) -> String {
        let quoted = |text: &str| serde_json::Value::from(text).to_string();
        let mut text = String::from(
            "# What the pipeline beside this file made: written by `deaflow run --lock`, checked by \
             `deaflow run --locked`.\n",
        );
        // Writing to a text cannot fail.
        let _ = write!(
            text,
            "version: 1\npipeline: {}\ntarget: {}\nstages:\n",
            quoted(&self.pipeline),
            quoted(&self.target)
        );
        for (name, stage) in &self.stages {
            let _ = write!(
                text,
                "  {}:\n    key: \"{}\"\n    artifact: \"{}\"\n",
                quoted(name),
                stage.key,
                stage.artifact
            );
        }
        text
    }
}

fn digest<T: FromStr<Err = ParseDigestError>>(node: &Node, field: &str) -> Result<T, InputError> {
    let text = node.text(field)?;
    text.parse().map_err(|error| {
        node.error(format!("`{field}` is not a digest: {error}"))
            .help("expected: 64 hexadecimal digits")
    })
}

impl Store {
    /// Registers the path of a lock file, so that garbage collection keeps its artifacts.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn remember_lock_file(&self, path: &Path) -> Result<(), StoreError> {
        let whole = fs::canonicalize(path).map_err(StoreError::io("find", path))?;
        let text = self.place_of(&whole).ok_or_else(|| StoreError::LockFile {
            path: whole.clone(),
            source: InputError::new("its path is not UTF-8"),
        })?;
        let target = self.layout.lock_files().join(Digest::of(text.as_bytes()).to_string());
        if read_own(&target, MAX_PATH).is_ok_and(|known| known == text.as_bytes()) {
            return Ok(());
        }
        let folder = self.temporary()?;
        atomic::write(&folder.path().join("lock-file"), &target, text.as_bytes())
    }

    /// Returns the registered lock files that exist, with their paths.
    ///
    /// # Errors
    /// If one exists and cannot be read, because its artifacts are unknown then.
    pub fn lock_files(&self) -> Result<Vec<(PathBuf, LockFile)>, StoreError> {
        let mut found = Vec::new();
        for entry in self.remembered_lock_files()? {
            let bytes = read_own(&entry, MAX_PATH).map_err(|error| match error.kind() {
                ErrorKind::InvalidInput | ErrorKind::FileTooLarge => StoreError::damaged(&entry, error.to_string()),
                _ => StoreError::io("read", &entry)(error),
            })?;
            let named = entry.file_name().and_then(|name| name.to_str());
            if named.is_none_or(|name| name != Digest::of(&bytes).to_string()) {
                return Err(StoreError::damaged(
                    &entry,
                    "it does not contain the path of a lock file",
                ));
            }
            let text = String::from_utf8_lossy(&bytes).into_owned();
            let is_gone = |path: &PathBuf| {
                let found = fs::metadata(path);
                found.is_err_and(|error| error.kind() == ErrorKind::NotFound)
            };
            let Some(path) = self.places(&text).into_iter().find(|path| !is_gone(path)) else {
                continue;
            };
            match LockFile::read(&path) {
                Ok(lock) => found.push((path, lock)),
                Err(source) => return Err(StoreError::LockFile { path, source }),
            }
        }
        Ok(found)
    }

    /// Returns the path of a lock file and, on a second line, the path relative to the store, which stays valid if both
    /// are moved.
    fn place_of(&self, whole: &Path) -> Option<String> {
        let store = fs::canonicalize(self.root()).ok()?;
        let shared = store.components().zip(whole.components());
        let shared = shared.take_while(|(a, b)| a == b).count();
        let up = store.components().skip(shared).map(|_| "..");
        let relative: PathBuf = up
            .map(Path::new)
            .chain(whole.components().skip(shared).map(|c| Path::new(c.as_os_str())))
            .collect();
        Some(format!("{}\n{}", whole.to_str()?, relative.to_str()?))
    }

    fn places(&self, text: &str) -> Vec<PathBuf> {
        let mut lines = text.lines();
        let whole = lines.next().map(PathBuf::from);
        let relative = lines.next().map(|relative| self.root().join(relative));
        whole.into_iter().chain(relative).collect()
    }

    /// Returns the files with the paths of lock files, by their names.
    pub(super) fn remembered_lock_files(&self) -> Result<Vec<PathBuf>, StoreError> {
        let is_named = |entry: &PathBuf| {
            let name = entry.file_name().and_then(|name| name.to_str());
            name.is_some_and(|name| name.parse::<Digest>().is_ok())
        };
        let entries = files_in_optional(&self.layout.lock_files())?;
        Ok(entries.into_iter().filter(is_named).collect())
    }

    /// Returns the files in that folder that do not contain the path of a lock file.
    pub(super) fn stray_lock_files(&self) -> Result<Vec<PathBuf>, StoreError> {
        let is_stray = |entry: &PathBuf| {
            let named = entry.file_name().and_then(|name| name.to_str());
            let bytes = read_own(entry, MAX_PATH).ok();
            let says = bytes.map(|bytes| Digest::of(&bytes).to_string());
            !is_hidden(entry) && (says.is_none() || says.as_deref() != named)
        };
        let entries = files_in_optional(&self.layout.lock_files())?;
        Ok(entries.into_iter().filter(is_stray).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lock() -> LockFile {
        let stage = |text: &str| LockedStage {
            key: ActionKey::of(text.as_bytes()),
            artifact: ArtifactId::of(b"artifact"),
        };
        LockFile {
            pipeline: "a \"name\": # odd".into(),
            target: "x86_64-linux, Some CPU @ 2 GHz".into(),
            stages: BTreeMap::from([("small".into(), stage("1")), ("no".into(), stage("2"))]),
        }
    }

    #[test]
    fn a_lock_file_says_what_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(&folder.path().join("store")).unwrap();
        let path = folder.path().join("p.yaml.lock");
        assert_eq!(LockFile::path_for(&folder.path().join("p.yaml")), path);
        lock().write(&path).unwrap();
        store.remember_lock_file(&path).unwrap();
        assert_eq!(LockFile::read(&path).unwrap(), lock());
        assert_eq!(
            store.lock_files().unwrap(),
            [(fs::canonicalize(&path).unwrap(), lock())]
        );
        // Moved with its store, it is found again.
        let (here, there) = (folder.path().join("project"), folder.path().join("moved"));
        fs::create_dir(&here).unwrap();
        let store = Store::open(&here.join("store")).unwrap();
        fs::create_dir(here.join("pipelines")).unwrap();
        let inside = here.join("pipelines/p.yaml.lock");
        lock().write(&inside).unwrap();
        store.remember_lock_file(&inside).unwrap();
        drop(store);
        fs::rename(&here, &there).unwrap();
        let store = Store::open(&there.join("store")).unwrap();
        assert_eq!(store.lock_files().unwrap()[0].1, lock());
        fs::remove_dir_all(&there).unwrap();
        // Nothing is left beside it.
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_lock_file_that_is_gone_holds_nothing_and_one_that_is_damaged_stops() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(&folder.path().join("store")).unwrap();
        let path = folder.path().join("p.lock");
        lock().write(&path).unwrap();
        store.remember_lock_file(&path).unwrap();
        fs::write(&path, lock().text().replace("artifact: \"", "artifact: \"x")).unwrap();
        assert!(
            LockFile::read(&path)
                .unwrap_err()
                .to_string()
                .contains("is not a digest")
        );
        let error = store.lock_files().unwrap_err();
        assert!(error.to_string().contains("p.lock"), "{error}");
        fs::remove_file(&path).unwrap();
        assert_eq!(store.lock_files().unwrap(), []);
    }
}
