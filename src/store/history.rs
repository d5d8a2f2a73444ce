//! The history of runs: time, host, overrides, and the key, artifact and results of each stage.
//!
//! It explains the next run ("parameter changed: …"), finds the artifact of a stage by name, can be listed and
//! compared, and tells a garbage collection what to keep. Cache hits do not depend on it: artifacts are found by their
//! keys.

use std::collections::{BTreeMap, BTreeSet, BinaryHeap, VecDeque};
use std::fs;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::atomic;
use super::entries::{files_in, is_file, is_hidden, names_in, remove_file};
use super::error::StoreError;
use super::open::Store;
use deaflow_base::{ActionKey, ArtifactId, Digest, read_own};

/// Number of runs that are kept.
const KEPT: usize = 10_000;

/// Maximum length of the file of a run: more than a pipeline of maximum size needs.
const MAX_BYTES: u64 = 32 << 20;

/// One run of a pipeline.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Its identifier: the digits in the name of its file. Empty before it is written.
    #[serde(skip)]
    pub id: String,
    /// Name of the pipeline.
    pub pipeline: String,
    /// Path of the file of the pipeline.
    pub path: String,
    /// The same path relative to the store, which may be moved together with its pipelines.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub place: String,
    /// The command that ran it.
    #[serde(default)]
    pub command: Command,
    /// When it ended, in UTC, RFC 3339.
    pub created: String,
    /// Duration, s.
    #[serde(default)]
    pub seconds: f64,
    /// Name of the machine.
    #[serde(default)]
    pub host: String,
    /// Version and build of the program.
    #[serde(default)]
    pub version: String,
    /// Overrides by `--set`: values in YAML by dotted path.
    #[serde(default)]
    pub overrides: BTreeMap<String, String>,
    /// Path of its log file, relative to the store; `None` if nothing was built.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log: Option<String>,
    /// The stages that were reached, in topological order.
    pub stages: Vec<RunStage>,
    /// Names of the stages that failed.
    #[serde(default)]
    pub failures: Vec<String>,
    /// Names of the stages that were stopped; their checkpoints are kept.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stopped: Vec<String>,
    /// Names of the stages that were not started because of these.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_begun: Vec<String>,
    /// Results of the artifacts, as `STAGE.NAME`.
    #[serde(default)]
    pub results: BTreeMap<String, f64>,
}

/// The command that ran a pipeline.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Command {
    /// `deaflow run`.
    #[default]
    Run,
    /// `deaflow audit`, which builds only one stage.
    Audit,
    /// `deaflow sweep`, whose stages are not those of the file.
    Sweep,
}

impl Command {
    /// Returns the name in files and JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Audit => "audit",
            Self::Sweep => "sweep",
        }
    }
}

/// How a stage of a run was obtained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StageOutcome {
    /// It was built.
    Built,
    /// Its artifact existed already.
    #[default]
    Reused,
}

impl StageOutcome {
    /// Returns the name in files and JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Built => "built",
            Self::Reused => "reused",
        }
    }
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
    /// Whether it was built or reused.
    #[serde(default)]
    pub outcome: StageOutcome,
    /// The parameters that it had from the scene and could have had of its own, by their paths; each followed by `=`
    /// and its path in the scene if that differs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub from_scene: Vec<String>,
}

impl Run {
    /// Returns the stage of that name.
    #[must_use]
    pub fn stage(&self, name: &str) -> Option<&RunStage> {
        self.stages.iter().find(|stage| stage.name == name)
    }

    /// Whether it reached the end of its pipeline: nothing failed or was stopped.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        [&self.failures, &self.stopped, &self.not_begun]
            .iter()
            .all(|names| names.is_empty())
    }

    /// Whether both have the same pipeline, overrides and artifacts.
    fn is_equivalent(&self, other: &Self) -> bool {
        let made = |run: &Self| -> Vec<(String, ActionKey, ArtifactId)> {
            let stages = run.stages.iter();
            stages
                .map(|stage| (stage.name.clone(), stage.key, stage.artifact))
                .collect()
        };
        (&self.pipeline, &self.path, &self.overrides) == (&other.pipeline, &other.path, &other.overrides)
            && made(self) == made(other)
    }
}

/// Reads runs on demand, newest first. Invalid files are skipped; `fsck` reports them.
pub struct Runs {
    folder: PathBuf,
    /// File names with their sort keys, in a heap: most callers read only the newest.
    names: BinaryHeap<(SortKey, String)>,
}

impl Iterator for Runs {
    type Item = Result<Run, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        std::iter::from_fn(|| self.names.pop()).find_map(|(_, name)| read(&self.folder.join(name)).transpose())
    }
}

impl Runs {
    /// Reads all runs in parallel, newest first.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn all(self) -> Result<Vec<Run>, StoreError> {
        let paths = self.paths();
        let runs = paths.par_iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;
        Ok(runs.into_iter().flatten().collect())
    }

    /// Returns the files, newest first.
    fn paths(self) -> Vec<PathBuf> {
        let sorted = self.names.into_sorted_vec().into_iter().rev();
        sorted.map(|(_, name)| self.folder.join(name)).collect()
    }
}

/// The sort key of runs: a time, and a number for runs with the same time.
type SortKey = (String, u64);

/// Selects the runs of the pipeline in a file, newest first.
///
/// Those are the runs with its path, and those of the same name with the same path relative to the store whose file no
/// longer exists: the store was moved together with the file. If there are none, the file may have been moved: then
/// they are the runs of the same name whose file no longer exists, if they all had the same path.
pub struct RunsOf<I> {
    runs: I,
    file: PathBuf,
    place: String,
    name: String,
    has_own: bool,
    /// Runs of the same name whose file no longer exists.
    orphans: VecDeque<Run>,
    gone: BTreeMap<String, bool>,
    is_resolved: bool,
}

impl<I> RunsOf<I> {
    fn is_gone(&mut self, path: &str) -> bool {
        let known = self.gone.entry(path.to_owned());
        *known.or_insert_with(|| !Path::new(path).exists())
    }

    /// Whether a run is of the same file before the store was moved together with it.
    fn was_moved(&mut self, run: &Run) -> bool {
        let is_same = run.pipeline == self.name && !run.place.is_empty() && run.place == self.place;
        is_same && self.is_gone(&run.path)
    }

    fn resolve_orphans(&mut self) {
        self.is_resolved = true;
        let paths: BTreeSet<&str> = self.orphans.iter().map(|run| run.path.as_str()).collect();
        if paths.len() > 1 {
            self.orphans.clear();
        }
    }
}

impl<I: Iterator<Item = Result<Run, StoreError>>> Iterator for RunsOf<I> {
    type Item = Result<Run, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_resolved {
            match self.runs.next() {
                Some(Ok(run)) if Path::new(&run.path) == self.file => {
                    self.has_own = true;
                    self.orphans.clear();
                    return Some(Ok(run));
                }
                Some(Ok(run)) if self.was_moved(&run) => {
                    self.has_own = true;
                    self.orphans.clear();
                    return Some(Ok(run));
                }
                Some(Ok(run)) => {
                    if !self.has_own && run.pipeline == self.name && self.is_gone(&run.path) {
                        self.orphans.push_back(run);
                    }
                }
                Some(Err(error)) => return Some(Err(error)),
                None => self.resolve_orphans(),
            }
        }
        self.orphans.pop_front().map(Ok)
    }
}

impl Store {
    /// Selects, from runs of this store, those of the pipeline of that name in a file.
    pub fn runs_of<I: Iterator<Item = Result<Run, StoreError>>>(&self, runs: I, file: &Path, name: &str) -> RunsOf<I> {
        RunsOf {
            runs,
            place: self.relative_path_to(file),
            file: file.to_owned(),
            name: name.to_owned(),
            has_own: false,
            orphans: VecDeque::new(),
            gone: BTreeMap::new(),
            is_resolved: false,
        }
    }

    /// Returns the path of a file relative to the store: `../pipelines/sweep.yaml`.
    #[must_use]
    pub fn relative_path_to(&self, file: &Path) -> String {
        let Ok(root) = fs::canonicalize(self.root()) else {
            return String::new();
        };
        let shared = root
            .components()
            .zip(file.components())
            .take_while(|(a, b)| a == b)
            .count();
        let up = root.components().skip(shared).map(|_| Component::ParentDir);
        let path: PathBuf = up.chain(file.components().skip(shared)).collect();
        path.display().to_string()
    }

    /// Whether a stage was built, failed or was stopped in a run, or the run differs from the last one of its pipeline.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn is_new_run(&self, run: &Run) -> Result<bool, StoreError> {
        let built = |stage: &RunStage| stage.outcome == StageOutcome::Built;
        if run.stages.iter().any(built) || !run.failures.is_empty() || !run.stopped.is_empty() {
            return Ok(true);
        }
        let last = self
            .runs()?
            .find(|other| !other.as_ref().is_ok_and(|other| other.path != run.path));
        Ok(!last.transpose()?.is_some_and(|last| last.is_equivalent(run)))
    }

    /// Writes a run unless it equals the last one, and removes all but the last ten thousand; those that cannot be
    /// removed stay until the next run.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn put_run(&self, run: &Run) -> Result<(), StoreError> {
        if !self.is_new_run(run)? {
            return Ok(());
        }
        let files = self.run_files()?;
        let text = serde_json::to_vec_pretty(run)?;
        let name = after_newest(run, &files);
        let target = self
            .layout
            .runs()
            .join(format!("{name}-{}.json", Digest::of(&text).short()));
        let folder = self.temporary()?;
        atomic::write(&folder.path().join("run"), &target, &text)?;
        let older = files.iter().skip(KEPT - 1);
        older.filter(|path| is_file(path)).for_each(|path| {
            let _ = remove_file(path);
        });
        Ok(())
    }

    /// Returns the runs, newest first.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn runs(&self) -> Result<Runs, StoreError> {
        let folder = self.layout.runs();
        let named = |name: String| Some((stamp(&name)?, name));
        let names = names_in(&folder)?.into_iter().filter_map(named).collect::<Vec<_>>();
        Ok(Runs {
            folder,
            names: names.into(),
        })
    }

    /// Returns the stage of this name in the last run that had it. `pipeline` restricts the search to a pipeline, by
    /// name or path.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn last_made(&self, stage: &str, pipeline: Option<&str>) -> Result<Option<RunStage>, StoreError> {
        let last = self.last_run_with(stage, pipeline)?;
        Ok(last.and_then(|run| run.stage(stage).cloned()))
    }

    /// Returns the last run that had a stage of this name, likewise.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn last_run_with(&self, stage: &str, pipeline: Option<&str>) -> Result<Option<Run>, StoreError> {
        for run in self.runs()? {
            let run = run?;
            let wanted = pipeline.is_none_or(|wanted| run.pipeline == wanted || run.path == wanted);
            if wanted && run.stage(stage).is_some() {
                return Ok(Some(run));
            }
        }
        Ok(None)
    }

    /// Returns the files of runs, newest first, by their names.
    pub(super) fn run_files(&self) -> Result<Vec<PathBuf>, StoreError> {
        Ok(self.runs()?.paths())
    }

    /// Returns the files in the folder of runs that are not runs.
    pub(super) fn stray_runs(&self) -> Result<Vec<PathBuf>, StoreError> {
        let is_stray = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str());
            !is_hidden(path) && name.and_then(stamp).is_none()
        };
        Ok(files_in(&self.layout.runs())?.into_iter().filter(is_stray).collect())
    }
}

/// Returns the start of the name of the file of a run: its time, `2026-01-01T00-00-01.000Z`. If the clock was set back,
/// it is the time of the newest file and a number, so that the last run is always the newest.
fn after_newest(run: &Run, newest_first: &[PathBuf]) -> String {
    let time: String = run.created.chars().map(|c| if c == ':' { '-' } else { c }).collect();
    let named = |path: &PathBuf| stamp(path.file_name()?.to_str()?);
    match newest_first.iter().find_map(named) {
        Some((newest, number)) if newest >= time => format!("{newest}.{:06}", number.saturating_add(1)),
        _ => time,
    }
}

/// Parses the name of the file of a run: `TIME-DIGEST.json` or `TIME.NUMBER-DIGEST.json`.
fn stamp(name: &str) -> Option<SortKey> {
    let (time, rest) = name.split_at_checked("2026-01-01T00-00-01.000Z".len())?;
    let form = |(at, c): (usize, char)| match at {
        4 | 7 | 13 | 16 => c == '-',
        10 => c == 'T',
        19 => c == '.',
        23 => c == 'Z',
        _ => c.is_ascii_digit(),
    };
    let (number, digest) = rest.strip_suffix(".json")?.split_once('-')?;
    let is_digest = digest.len() == Digest::SHORT && digest.bytes().all(|byte| byte.is_ascii_hexdigit());
    let number = match number.strip_prefix('.') {
        Some(digits) => digits.parse().ok()?,
        None if number.is_empty() => 0,
        None => return None,
    };
    (is_digest && time.chars().enumerate().all(form)).then(|| (time.to_owned(), number))
}

/// Reads a run; returns `None` if the file is not valid, or another process has just removed it.
pub(super) fn read(path: &Path) -> Result<Option<Run>, StoreError> {
    match read_own(path, MAX_BYTES) {
        Ok(bytes) => Ok(serde_json::from_slice(&bytes)
            .ok()
            .map(|run| Run { id: id(path), ..run })),
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::NotFound
                    | ErrorKind::StaleNetworkFileHandle
                    | ErrorKind::InvalidInput
                    | ErrorKind::FileTooLarge
            ) =>
        {
            Ok(None)
        }
        Err(error) => Err(StoreError::io("read", path)(error)),
    }
}

/// Returns the digits in the name of the file of a run.
fn id(path: &Path) -> String {
    let name = path.file_stem().and_then(|name| name.to_str());
    let digits = name.and_then(|name| name.rsplit_once('-'));
    digits.map_or_else(String::new, |(_, digits)| digits.to_owned())
}

/// Writes digests as hexadecimal text.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn run(created: &str, pipeline: &str) -> Run {
        Run {
            pipeline: pipeline.to_owned(),
            path: "p.yaml".into(),
            created: created.to_owned(),
            ..Run::default()
        }
    }

    #[test]
    fn only_names_of_ours_are_runs() {
        let time = "2026-01-01T00-00-01.000Z";
        let digest = "0123456789ab";
        assert_eq!(stamp(&format!("{time}-{digest}.json")), Some((time.to_owned(), 0)));
        assert_eq!(
            stamp(&format!("{time}.000012-{digest}.json")),
            Some((time.to_owned(), 12))
        );
        for other in [
            format!("{time}-{digest}.json~"),
            format!("{time}-{digest} copy.json"),
            format!("{time}-note-{digest}.json"),
            format!("{time}-.json"),
            format!("{time}.json"),
            format!("{time}.99999999999999999999999-{digest}.json"),
            format!("{time}x-{digest}.json"),
            format!("._{time}-{digest}.json"),
            "é026-01-01T00-00-01.000Z-0123456789ab.json".into(),
        ] {
            assert_eq!(stamp(&other), None, "{other}");
        }
    }

    #[test]
    fn the_new_run_is_the_newest_whatever_numbers_are_there() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let runs = store.layout.runs();
        let last = |store: &Store| store.runs().unwrap().next().unwrap().unwrap().pipeline;
        store.put_run(&run("2026-01-01T00:00:01.000Z", "first")).unwrap();
        for number in ["999999", "1000000"] {
            let name = format!("2999-01-01T00-00-01.000Z.{number}-0123456789ab.json");
            let text = serde_json::to_vec(&run("2999-01-01T00:00:01.000Z", number)).unwrap();
            fs::write(runs.join(name), text).unwrap();
        }
        assert_eq!(last(&store), "1000000");
        store.put_run(&run("2026-01-01T00:00:02.000Z", "second")).unwrap();
        assert_eq!(last(&store), "second");
        let highest = format!("2999-01-01T00-00-01.000Z.{}-0123456789ab.json", u64::MAX);
        fs::write(runs.join(highest), "{}").unwrap();
        store.put_run(&run("2026-01-01T00:00:03.000Z", "third")).unwrap();
        assert!(
            store.runs().unwrap().any(|run| run.unwrap().pipeline == "third"),
            "it does not go"
        );
    }
}
