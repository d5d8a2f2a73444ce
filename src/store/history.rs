//! The last runs: what each stage was made by and what it made.
//!
//! They explain the next run ("parameter changed: …"), let a stage be shown by its name, and are what a collection must
//! keep. They decide nothing: a run is found by its keys whether or not its file is there.

use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::atomic;
use super::error::StoreError;
use super::open::Store;
use crate::base::{ActionKey, ArtifactId, Digest, read_bounded};

/// How many runs are remembered.
const KEPT: usize = 50;

/// A run of as many stages as a pipeline may have takes less.
const MAX_BYTES: u64 = 32 << 20;

/// One run of a pipeline.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Run {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Its file.
    pub path: String,
    /// When it ended, in UTC, RFC 3339; of runs in a row that say the same, the first.
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
    pub key: ActionKey,
    /// Its artifact.
    #[serde(with = "hexadecimal")]
    pub artifact: ArtifactId,
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
    /// Remembers a run in place of an earlier one that says the same, and forgets all but the last fifty. The last run said
    /// again is no news: nothing is written.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn put_run(&self, run: &Run) -> Result<(), StoreError> {
        let last = self.run_files()?.first().map(|path| read(path)).transpose()?;
        if last.flatten().is_some_and(|last| last.says_the_same(run)) {
            return Ok(());
        }
        let text = serde_json::to_vec_pretty(run).map_err(|error| StoreError::Json(error.to_string()))?;
        let name = after_newest(run, &self.run_files()?);
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

    /// Files of runs, newest first, as their names say.
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

/// The time of a run as its file's name begins with it: `2026-01-01T00-00-01.000Z`. Where the clock has been set back, the
/// newest file's time and a number instead, so that the last run is the newest whatever the clock says.
fn after_newest(run: &Run, newest_first: &[PathBuf]) -> String {
    let time: String = run.created.chars().map(|c| if c == ':' { '-' } else { c }).collect();
    let named = |path: &PathBuf| stamp(path.file_name()?.to_str()?);
    match newest_first.iter().find_map(named) {
        // '.' sorts after the '-' that follows a time without a number.
        Some((newest, number)) if newest >= time => format!("{newest}.{:06}", number + 1),
        _ => time,
    }
}

/// Time and number in the name of a run's file; none where it is named otherwise.
fn stamp(name: &str) -> Option<(String, u64)> {
    let (time, rest) = name.split_at_checked("2026-01-01T00-00-01.000Z".len())?;
    let form = |(at, c): (usize, char)| match at {
        4 | 7 | 13 | 16 => c == '-',
        10 => c == 'T',
        19 => c == '.',
        23 => c == 'Z',
        _ => c.is_ascii_digit(),
    };
    let well_formed = time.chars().enumerate().all(form) && rest.ends_with(".json");
    let number = rest
        .strip_prefix('.')
        .and_then(|rest| rest.split('-').next()?.parse().ok());
    well_formed.then(|| (time.to_owned(), number.unwrap_or(0)))
}

/// `None` where the file is no run, or another process has just removed it.
pub(super) fn read(path: &std::path::Path) -> Result<Option<Run>, StoreError> {
    match read_bounded(path, MAX_BYTES) {
        Ok(bytes) => Ok(serde_json::from_slice(&bytes).ok()),
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::NotFound | ErrorKind::InvalidInput | ErrorKind::FileTooLarge
            ) =>
        {
            Ok(None)
        }
        Err(error) => Err(StoreError::io("read", path)(error)),
    }
}

fn remove(path: &std::path::Path) -> Result<(), StoreError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(StoreError::io("remove", path)(error)),
        _ => Ok(()),
    }
}

/// Digests as people and other programs read them.
mod hexadecimal {
    use std::fmt::Display;
    use std::str::FromStr;

    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<T: Display, S: Serializer>(id: &T, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(id)
    }

    pub fn deserialize<'de, T: FromStr<Err: Display>, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}
