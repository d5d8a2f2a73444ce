//! Arguments that several commands share.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use clap::builder::{PathBufValueParser, TypedValueParser};

use super::error::CliError;
use super::output::Output;
use super::project;
use super::upstream::{Reading, RemoteArguments};
use deaflow_base::{Dimension, NodeValue, Override, Quantity, Time, read_bounded};
use deaflow_fem::WorkLimit;
use deaflow_scene::Scene;
use deaflow_store::Store;

/// The heading of options about the pipeline.
pub const PIPELINE: &str = "Pipeline";

/// The heading of options about the store.
pub const STORE: &str = "Store";

/// The heading of options about what is shown meanwhile.
pub const PROGRESS: &str = "Progress";

/// No job takes longer.
const LONGEST: Duration = Duration::from_secs(366 * 24 * 3600);

#[derive(Clone, Debug, Args)]
pub struct StoreArguments {
    /// The artifact store [default: $DEAFLOW_STORE, or else `store` in the nearest folder at or above the pipeline (without one, this
    /// folder) that has a store or is a Git repository]
    #[arg(long, value_name = "DIR", help_heading = STORE)]
    store: Option<PathBuf>,
}

impl StoreArguments {
    /// The folder that the command line names.
    pub fn given(&self) -> Option<&Path> {
        self.store.as_deref()
    }

    /// The folder of the store, for a command that is about no pipeline.
    pub fn folder(&self) -> PathBuf {
        self.folder_for(None)
    }

    /// The folder of the store for a pipeline.
    pub fn folder_of(&self, pipeline: &Path) -> PathBuf {
        self.folder_for(Some(pipeline))
    }

    /// The folder of the store for the first of these that names a pipeline, be it as `PIPELINE.yaml:STAGE` or `PIPELINE.yaml@RUN`.
    pub fn folder_of_any<'a>(&self, references: impl IntoIterator<Item = &'a String>) -> PathBuf {
        let file = |reference: &'a String| {
            reference
                .rsplit_once([':', '@'])
                .map_or(reference.as_str(), |(file, _)| file)
        };
        let mut files = references.into_iter().map(|reference| Path::new(file(reference)));
        self.folder_for(files.find(|file| file.extension().is_some_and(|end| end == "yaml" || end == "yml")))
    }

    /// The folder of the store for a pipeline, if there is one.
    pub fn folder_for(&self, pipeline: Option<&Path>) -> PathBuf {
        let set = || std::env::var_os("DEAFLOW_STORE").filter(|value| !value.is_empty());
        self.store
            .clone()
            .or_else(|| set().map(PathBuf::from))
            .unwrap_or_else(|| project::store(pipeline))
    }
}

#[derive(Clone, Debug, Args)]
pub struct StateArguments {
    /// Look at this state of the device alone
    #[arg(long, value_name = "NAME")]
    pub state: Option<String>,
}

impl StateArguments {
    /// What is looked at, in words: a scene of a file, and its state.
    #[must_use]
    pub fn described(&self, scene: &Path) -> String {
        let state = self
            .state
            .as_ref()
            .map_or_else(String::new, |state| format!(" in state {state}"));
        format!("scene {}{state}", scene.display())
    }

    /// A scene in the state that is asked for; as it is where none is.
    ///
    /// # Errors
    /// When it has no such state.
    pub fn of(&self, scene: Scene) -> Result<Scene, CliError> {
        match &self.state {
            None => Ok(scene),
            Some(wanted) => scene
                .in_state(wanted)
                .map_err(|unknown| CliError::bad_input(unknown.to_string()).help(unknown.help())),
        }
    }
}

#[derive(Clone, Debug, Args)]
pub struct SetArguments {
    /// Change a value for this call, such as stages.small.count=400 or scene.drive.voltage="5 kV"; scene=FILE takes another scene
    #[arg(long = "set", value_name = "PATH=VALUE", help_heading = PIPELINE)]
    pub sets: Vec<String>,
    /// Allow a sweep of more than 1000 stages
    #[arg(long, help_heading = PIPELINE)]
    pub many: bool,
}

impl SetArguments {
    /// The changes, in order.
    ///
    /// # Errors
    /// When one cannot be read.
    pub fn overrides(&self) -> Result<Vec<Override>, CliError> {
        self.sets.iter().map(|set| Ok(Override::parse(set)?)).collect()
    }

    /// The changes as another process takes them, whatever its folder: the file of a scene is named from the root.
    pub fn named_from_root(&self) -> Vec<String> {
        let full = |set: &String| {
            let set = Override::parse(set).ok()?;
            let NodeValue::Text(file) = set.value() else {
                return None;
            };
            let file = (set.path() == ["scene"])
                .then(|| std::path::absolute(file).ok())
                .flatten()?;
            Some(format!("scene={}", serde_json::json!(file.to_str()?)))
        };
        self.sets
            .iter()
            .map(|set| full(set).unwrap_or_else(|| set.clone()))
            .collect()
    }
}

#[derive(Clone, Debug, Args)]
pub struct PipelineArguments {
    /// The pipeline, a YAML file, or a folder with one alone [default: that of this folder]
    #[arg(default_value = ".", hide_default_value = true, value_parser = pipeline_parser())]
    pub pipeline: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Stop after this stage
    #[arg(long, value_name = "STAGE", help_heading = PIPELINE)]
    pub until: Option<String>,
    #[command(flatten)]
    pub set: SetArguments,
    /// Rehash every file; ignore cached sizes and times
    #[arg(long, help_heading = STORE)]
    pub verify: bool,
    #[command(flatten)]
    pub remote: RemoteArguments,
}

/// What an argument that names a pipeline is read by.
pub fn pipeline_parser() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(pipeline_in)
}

/// The only pipeline of a folder; a file as it is.
pub fn pipeline_in(path: PathBuf) -> Result<PathBuf, String> {
    if !path.is_dir() {
        return Ok(path);
    }
    let shown = path.display();
    let entries = std::fs::read_dir(&path).map_err(|error| format!("cannot read the folder {shown}: {error}"))?;
    let mut found: Vec<PathBuf> = entries
        .filter_map(|entry| Some(PathBuf::from(entry.ok()?.file_name())))
        .filter(|name| name.extension().is_some_and(|end| end == "yaml" || end == "yml"))
        .map(|name| if path == Path::new(".") { name } else { path.join(name) })
        .filter(|file| has_stages(file))
        .collect();
    found.sort();
    match found.as_slice() {
        [one] => Ok(one.clone()),
        [] if Store::is_at(&path) => Err(format!(
            "{shown} is a store, and a pipeline is meant: `--store {shown}` names a store"
        )),
        [] => Err(format!(
            "there is no pipeline in {shown}, which is a YAML file with `stages:`"
        )),
        several => {
            let names: Vec<String> = several.iter().map(|file| file.display().to_string()).collect();
            Err(format!("there are several pipelines in {shown}: {}", names.join(", ")))
        }
    }
}

/// A pipeline is longer than this only where somebody has written it out for tens of thousands of stages.
const LONGEST_PIPELINE: u64 = 16 << 20;

/// Whether a file is a pipeline, or would be but for a mistake in it.
fn has_stages(file: &Path) -> bool {
    let text = read_bounded(file, LONGEST_PIPELINE).unwrap_or_default();
    text.split(|byte| *byte == b'\n')
        .any(|line| line.starts_with(b"stages:"))
}

impl PipelineArguments {
    /// The folder of the store.
    pub fn store_folder(&self) -> PathBuf {
        self.store.folder_of(&self.pipeline)
    }

    /// The store as it is to be looked at.
    ///
    /// # Errors
    /// When the remote that is to be read through cannot be.
    pub fn read(&self, store: Store, output: &Output) -> Result<Reading, CliError> {
        let store = if self.verify { store.without_index() } else { store };
        Reading::of(store, &self.remote, output)
    }
}

#[derive(Debug, Args)]
pub struct PatternArguments {
    /// FILE.npy, FILE.csv, FILE.png or FILE.h5:/dataset
    #[arg(value_name = "PATTERN", required = true)]
    pub patterns: Vec<String>,
    /// Where the result goes; an existing file is replaced [default: nowhere, what was found is printed]
    #[arg(short, long, value_name = "OUT.h5")]
    pub output: Option<PathBuf>,
}

/// How HDF5 files end, the usual way first.
pub const HDF5: [&str; 2] = ["h5", "hdf5"];

/// Whether a path ends as HDF5 files do.
pub fn ends_as_hdf5(path: &Path) -> bool {
    path.extension()
        .is_some_and(|end| HDF5.iter().any(|known| end == *known))
}

impl PatternArguments {
    /// The file of what is written in any case.
    ///
    /// # Errors
    /// When none is named.
    pub fn file(&self) -> Result<&Path, CliError> {
        let none = || CliError::bad_input("no file is named for the result").help("name it with -o, as in -o out.h5");
        self.output.as_deref().ok_or_else(none)
    }

    /// Refuses a name that promises another format than HDF5. One without an ending promises none.
    ///
    /// # Errors
    /// When it does.
    pub fn check_ending(&self) -> Result<(), CliError> {
        let Some((file, end)) = self.output.as_deref().and_then(|file| Some((file, file.extension()?))) else {
            return Ok(());
        };
        if ends_as_hdf5(file) {
            return Ok(());
        }
        let message = format!(
            "{} cannot be written: the result is an HDF5 file, and not .{}",
            file.display(),
            end.display()
        );
        Err(CliError::bad_input(message)
            .help("allowed: .h5 and .hdf5, as in -o out.h5; `deaflow show out.h5 --csv` prints its rows as CSV, `--corners` the displacement of each corner"))
    }
}

/// Relative residual at which an equilibrium is accepted unless said otherwise.
pub const TOLERANCE: f64 = 1e-8;

/// Reads an accuracy of the displacement, a length.
pub fn accuracy(text: &str) -> Result<Quantity, String> {
    let length = Quantity::parse(text, Dimension::Length).map_err(|e| e.to_string())?;
    if (1e-9..=1e3).contains(&length.value()) {
        Ok(length)
    } else {
        Err("allowed: 1e-9 mm to 1000 mm".to_owned())
    }
}

#[derive(Debug, Args)]
pub struct TimeArguments {
    /// About how long a pattern may take before it ends as work-limit, as in "60 s" [default: 5 s, and 500 s for a history]; work is counted, not
    /// time, so that results do not depend on the machine
    #[arg(long, value_name = "TIME", value_parser = time_limit, allow_hyphen_values = true)]
    pub time_limit: Option<Time>,
}

impl TimeArguments {
    /// How much work a pattern may take.
    pub fn work_limit(&self) -> WorkLimit {
        WorkLimit::of_time(self.time_limit.as_ref())
    }
}

/// Reads a time that goes by, as in "5min" or "2 h".
pub fn duration(text: &str) -> Result<Duration, String> {
    let duration = humantime::parse_duration(text).map_err(|error| error.to_string())?;
    if duration <= LONGEST {
        Ok(duration)
    } else {
        Err("allowed: 0s to 366days".to_owned())
    }
}

/// Reads a time for which patterns may be worked on.
fn time_limit(text: &str) -> Result<Time, String> {
    let time = Quantity::parse(text, Dimension::Time).map_err(|e| e.to_string())?;
    match Time::from_f64(time.value()) {
        Some(time) if (1e-3..=1e6).contains(&time.value()) => Ok(time),
        _ => Err("allowed: 1 ms to 1e6 s".to_owned()),
    }
}

/// A reader of numbers between two bounds, in the words of `allowed`.
pub fn number(
    allowed: std::ops::RangeInclusive<f64>,
    words: &'static str,
) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        let value = text.parse::<f64>().map_err(|e| e.to_string())?;
        if allowed.contains(&value) {
            Ok(value)
        } else {
            Err(format!("allowed: {words}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_stands_for_its_only_pipeline() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let of_folder = || pipeline_in(folder.path().to_owned());
        assert!(of_folder().unwrap_err().contains("no pipeline"));
        std::fs::write(path("scene.yaml"), "geometry: {}\n").unwrap();
        std::fs::write(path("a.yaml"), "name: a\nstages: {}\n").unwrap();
        assert_eq!(of_folder(), Ok(path("a.yaml")));
        std::fs::write(path("b.yml"), "stages:\n").unwrap();
        let several = of_folder().unwrap_err();
        assert!(several.contains("a.yaml") && several.contains("b.yml"), "{several}");
        // What is no folder is read, or refused, as what it is.
        assert_eq!(pipeline_in(path("none.yaml")), Ok(path("none.yaml")));
    }

    #[test]
    fn numbers_have_bounds() {
        let tolerance = number(1e-12..=1e-3, "1e-12 to 1e-3");
        assert_eq!(tolerance("1e-8"), Ok(1e-8));
        for refused in ["0", "NaN", "1", "-1e-8", "x"] {
            assert!(tolerance(refused).is_err(), "{refused}");
        }
    }
}
