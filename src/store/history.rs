//! The last runs: what each stage was made by and what it made.
//!
//! They explain the next run ("parameter changed: …"), let a stage be shown by its name, and are what a collection must
//! keep. They decide nothing: a run is found by its keys whether or not its file is there.

use std::fs;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::atomic;
use super::error::StoreError;
use super::open::Store;
use crate::base::Digest;

/// How many runs are remembered.
const KEPT: usize = 50;

/// One run of a pipeline.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Run {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Its file.
    pub path: String,
    /// When it ended, in UTC, RFC 3339.
    pub created: String,
    /// The stages that were built or reused, in topological order.
    pub stages: Vec<RunStage>,
}

/// One stage of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunStage {
    /// Its name in the pipeline.
    pub name: String,
    /// Its kind.
    pub kind: String,
    /// Its action key.
    #[serde(with = "hexadecimal")]
    pub key: Digest,
    /// Its artifact.
    #[serde(with = "hexadecimal")]
    pub artifact: Digest,
}

impl Run {
    /// The stage of that name.
    #[must_use]
    pub fn stage(&self, name: &str) -> Option<&RunStage> {
        self.stages.iter().find(|stage| stage.name == name)
    }

    fn says_the_same(&self, other: &Self) -> bool {
        (&self.pipeline, &self.path, &self.stages) == (&other.pipeline, &other.path, &other.stages)
    }
}

impl Store {
    /// Remembers a run in place of an earlier one that says the same, and forgets all but the last fifty.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn put_run(&self, run: &Run) -> Result<(), StoreError> {
        let text = serde_json::to_vec_pretty(run).map_err(|error| StoreError::Json(error.to_string()))?;
        let name: String = run.created.chars().map(|c| if c == ':' { '-' } else { c }).collect();
        let target = self
            .layout
            .runs()
            .join(format!("{name}-{}.json", Digest::of(&text).short()));
        let folder = self.temporary()?;
        atomic::write(&folder.path().join("run"), &target, &text)?;
        let mut kept = 0;
        for path in self.run_files()? {
            let same = path != target && read(&path)?.is_some_and(|other| other.says_the_same(run));
            if same || kept >= KEPT {
                remove(&path)?;
            } else {
                kept += 1;
            }
        }
        Ok(())
    }

    /// The remembered runs, newest first. A file that cannot be understood is passed over; `fsck` names it.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn runs(&self) -> Result<Vec<Run>, StoreError> {
        let mut runs = Vec::new();
        for path in self.run_files()? {
            runs.extend(read(&path)?);
        }
        Ok(runs)
    }

    /// What the last run that had a stage of this name made there. `pipeline` narrows to a pipeline by name or file.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn last_made(&self, stage: &str, pipeline: Option<&str>) -> Result<Option<RunStage>, StoreError> {
        let mut runs = self.runs()?;
        runs.retain(|run| pipeline.is_none_or(|wanted| run.pipeline == wanted || run.path == wanted));
        Ok(runs.iter().find_map(|run| run.stage(stage)).cloned())
    }

    /// Files of runs, newest first: their names begin with the time.
    pub(super) fn run_files(&self) -> Result<Vec<PathBuf>, StoreError> {
        let folder = self.layout.runs();
        let mut files = Vec::new();
        for entry in fs::read_dir(&folder).map_err(StoreError::io("read", &folder))? {
            files.push(entry.map_err(StoreError::io("read", &folder))?.path());
        }
        files.sort_unstable_by(|a, b| b.cmp(a));
        Ok(files)
    }
}

/// `None` where the file is no run, or another process has just removed it.
pub(super) fn read(path: &std::path::Path) -> Result<Option<Run>, StoreError> {
    match fs::read(path) {
        Ok(bytes) => Ok(serde_json::from_slice(&bytes).ok()),
        Err(error)
            if matches!(
                error.kind(),
                std::io::ErrorKind::NotFound | std::io::ErrorKind::IsADirectory
            ) =>
        {
            Ok(None)
        }
        Err(error) => Err(StoreError::io("read", path)(error)),
    }
}

fn remove(path: &std::path::Path) -> Result<(), StoreError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(StoreError::io("remove", path)(error)),
        _ => Ok(()),
    }
}

/// Digests as people and other programs read them.
mod hexadecimal {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    use crate::base::Digest;

    pub fn serialize<S: Serializer>(digest: &Digest, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(digest)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Digest, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}
