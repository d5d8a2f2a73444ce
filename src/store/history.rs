//! Past runs: when, where, with which overrides, what each stage was made by and what it made, and what that is worth in numbers.
//!
//! They explain the next run ("parameter changed: …"), let a stage be shown by its name, can be listed and compared, and the last of
//! them are what a collection must keep. They decide nothing: a run is found by its keys whether or not its file is there.

use std::collections::{BTreeMap, BTreeSet, BinaryHeap, VecDeque};
use std::fs;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::atomic;
use super::entries::{files_in, is_file, is_hidden, names_in};
use super::error::StoreError;
use super::open::Store;
use deaflow_base::{ActionKey, ArtifactId, Digest, read_own};

/// How many runs are remembered.
const KEPT: usize = 10_000;

/// A run of as many stages as a pipeline may have takes less.
const MAX_BYTES: u64 = 32 << 20;

/// One run of a pipeline.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// By which it is named: the digits in the name of its file. Empty before it is put.
    #[serde(skip)]
    pub id: String,
    /// Name of the pipeline.
    pub pipeline: String,
    /// Its file, by which runs belong together.
    pub path: String,
    /// The same as seen from the store, which may be moved with its pipelines.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub place: String,
    /// The command that ran it.
    #[serde(default)]
    pub command: Command,
    /// When it ended, in UTC, RFC 3339.
    pub created: String,
    /// What it took from its beginning to its end, s.
    #[serde(default)]
    pub seconds: f64,
    /// Name of the machine.
    #[serde(default)]
    pub host: String,
    /// Version of this program, and which build of it.
    #[serde(default)]
    pub version: String,
    /// What `--set` changed: values in YAML by their dotted paths.
    #[serde(default)]
    pub overrides: BTreeMap<String, String>,
    /// Its log file, in the folder of the store; none where nothing was built.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log: Option<String>,
    /// The stages that were reached, in topological order.
    pub stages: Vec<RunStage>,
    /// Names of the stages that failed.
    #[serde(default)]
    pub failures: Vec<String>,
    /// Names of the stages that were stopped; what they had come to is kept.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stopped: Vec<String>,
    /// Names of the stages that were not begun, because of these.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_begun: Vec<String>,
    /// What artifacts are worth in numbers: `STAGE.NAME`.
    #[serde(default)]
    pub results: BTreeMap<String, f64>,
}

/// What ran a pipeline.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Command {
    /// `deaflow run`.
    #[default]
    Run,
    /// `deaflow audit`, which builds one stage and no more.
    Audit,
    /// `deaflow sweep`, whose stages are not those of the file.
    Sweep,
}

impl Command {
    /// The word in files and documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Audit => "audit",
            Self::Sweep => "sweep",
        }
    }
}

/// How a stage of a run ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StageOutcome {
    /// It was built.
    Built,
    /// It was there.
    #[default]
    Reused,
}

impl StageOutcome {
    /// The word in files and documents.
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
    /// How it ended.
    #[serde(default)]
    pub outcome: StageOutcome,
}

impl Run {
    /// The stage of that name.
    #[must_use]
    pub fn stage(&self, name: &str) -> Option<&RunStage> {
        self.stages.iter().find(|stage| stage.name == name)
    }

    /// Whether it is the same pipeline, with the same overrides and the same artifacts.
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

/// Runs that are read as they are asked for, newest first. A file that cannot be understood is passed over; `fsck` names it.
pub struct Runs {
    folder: PathBuf,
    /// Names with what orders them. Most readers want the newest alone, so nothing is sorted beforehand.
    names: BinaryHeap<(Stamp, String)>,
}

impl Iterator for Runs {
    type Item = Result<Run, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        std::iter::from_fn(|| self.names.pop()).find_map(|(_, name)| read(&self.folder.join(name)).transpose())
    }
}

impl Runs {
    /// All of them, newest first, read by several threads.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn all(self) -> Result<Vec<Run>, StoreError> {
        let paths = self.paths();
        let runs = paths.par_iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;
        Ok(runs.into_iter().flatten().collect())
    }

    /// The files, newest first.
    fn paths(self) -> Vec<PathBuf> {
        let sorted = self.names.into_sorted_vec().into_iter().rev();
        sorted.map(|(_, name)| self.folder.join(name)).collect()
    }
}

/// What orders runs: a time, and a number where there are several of one time.
type Stamp = (String, u64);

/// Of some runs, newest first, those of the pipeline in a file.
///
/// A file has the runs that were of its path. One that has none has been moved or copied, or is new: it has those of its name whose file is
/// gone, if that stood in the same place as seen from the store, or if they are all of one file.
pub struct RunsOf<I> {
    runs: I,
    file: PathBuf,
    place: String,
    name: String,
    has_own: bool,
    /// Runs of the same name whose file is gone.
    orphans: VecDeque<Run>,
    gone: BTreeMap<String, bool>,
    is_sorted_out: bool,
}

impl<I> RunsOf<I> {
    fn is_gone(&mut self, path: &str) -> bool {
        let known = self.gone.entry(path.to_owned());
        *known.or_insert_with(|| !Path::new(path).exists())
    }

    fn sort_out(&mut self) {
        self.is_sorted_out = true;
        if self.orphans.iter().any(|run| run.place == self.place) {
            self.orphans.retain(|run| run.place == self.place);
        }
        let paths: BTreeSet<&str> = self.orphans.iter().map(|run| run.path.as_str()).collect();
        if paths.len() > 1 {
            self.orphans.clear();
        }
    }
}

impl<I: Iterator<Item = Result<Run, StoreError>>> Iterator for RunsOf<I> {
    type Item = Result<Run, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_sorted_out {
            match self.runs.next() {
                Some(Ok(run)) if Path::new(&run.path) == self.file => {
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
                None => self.sort_out(),
            }
        }
        self.orphans.pop_front().map(Ok)
    }
}

impl Store {
    /// Of some runs of this store, newest first, those of the pipeline of that name in a file.
    pub fn runs_of<I: Iterator<Item = Result<Run, StoreError>>>(&self, runs: I, file: &Path, name: &str) -> RunsOf<I> {
        RunsOf {
            runs,
            place: self.relative_path_to(file),
            file: file.to_owned(),
            name: name.to_owned(),
            has_own: false,
            orphans: VecDeque::new(),
            gone: BTreeMap::new(),
            is_sorted_out: false,
        }
    }

    /// A file as seen from the store: `../pipelines/sweep.yaml`.
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

    /// Whether something was built, failed or was stopped in a run, or it says anything else than the last one of its pipeline.
    ///
    /// # Errors
    /// When the system refuses.
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

    /// Remembers a run that is news, and forgets all but the last ten thousand.
    ///
    /// # Errors
    /// When the system refuses.
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
        older.filter(|path| is_file(path)).try_for_each(|path| remove(path))
    }

    /// The remembered runs, newest first.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn runs(&self) -> Result<Runs, StoreError> {
        let folder = self.layout.runs();
        let named = |name: String| Some((stamp(&name)?, name));
        let names = names_in(&folder)?.into_iter().filter_map(named).collect::<Vec<_>>();
        Ok(Runs {
            folder,
            names: names.into(),
        })
    }

    /// What the last run that had a stage of this name made there. `pipeline` narrows to a pipeline by name or file.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn last_made(&self, stage: &str, pipeline: Option<&str>) -> Result<Option<RunStage>, StoreError> {
        for run in self.runs()? {
            let run = run?;
            let wanted = pipeline.is_none_or(|wanted| run.pipeline == wanted || run.path == wanted);
            if let Some(found) = run.stage(stage).filter(|_| wanted) {
                return Ok(Some(found.clone()));
            }
        }
        Ok(None)
    }

    /// Files of runs, newest first, as their names say. What is named otherwise is none.
    pub(super) fn run_files(&self) -> Result<Vec<PathBuf>, StoreError> {
        Ok(self.runs()?.paths())
    }

    /// What lies among the files of runs and is none.
    pub(super) fn stray_runs(&self) -> Result<Vec<PathBuf>, StoreError> {
        let is_stray = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str());
            !is_hidden(path) && name.and_then(stamp).is_none()
        };
        Ok(files_in(&self.layout.runs())?.into_iter().filter(is_stray).collect())
    }
}

/// The time of a run as its file's name begins with it: `2026-01-01T00-00-01.000Z`. Where the clock has been set back, the
/// newest file's time and a number instead, so that the last run is the newest whatever the clock says.
fn after_newest(run: &Run, newest_first: &[PathBuf]) -> String {
    let time: String = run.created.chars().map(|c| if c == ':' { '-' } else { c }).collect();
    let named = |path: &PathBuf| stamp(path.file_name()?.to_str()?);
    match newest_first.iter().find_map(named) {
        Some((newest, number)) if newest >= time => format!("{newest}.{:06}", number.saturating_add(1)),
        _ => time,
    }
}

/// Time and number in the name of a run's file: `TIME-DIGEST.json` or `TIME.NUMBER-DIGEST.json`; none where it is named otherwise.
fn stamp(name: &str) -> Option<Stamp> {
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

/// `None` where the file is no run, or another process has just removed it.
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

/// The digits in the name of a run's file.
fn id(path: &Path) -> String {
    let name = path.file_stem().and_then(|name| name.to_str());
    let digits = name.and_then(|name| name.rsplit_once('-'));
    digits.map_or_else(String::new, |(_, digits)| digits.to_owned())
}

fn remove(path: &Path) -> Result<(), StoreError> {
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
