//! Arguments that several commands share.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use clap::builder::{PathBufValueParser, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};

use super::progress::ProgressMode;
use super::{CliError, project};
use deaflow_base::{Dimension, InputError, NodeValue, Override, Quantity, Time, read_bounded};
use deaflow_design::DesignFilter;
use deaflow_fem::WorkLimit;
use deaflow_pattern::{DrawingOptions, DrawingUnit, Edges, PatternForm, PictureFormat, Role};
use deaflow_scene::Scene;
use deaflow_stage::direct::{self, NamedPatterns};
use deaflow_store::Store;

/// The heading of options about the pipeline.
pub const PIPELINE: &str = "Pipeline";

/// The heading of options about the store.
pub const STORE: &str = "Store";

/// The heading of options about progress.
pub const PROGRESS: &str = "Progress";

/// The longest duration.
const MAX_DURATION: Duration = Duration::from_secs(366 * 24 * 3600);

#[derive(Clone, Debug, Args)]
pub struct StoreArguments {
    /// The artifact store [default: $DEAFLOW_STORE, or `store` in the nearest folder at or above the pipeline (or else
    /// the current folder) that has a store or is a Git repository]
    #[arg(long, value_name = "DIR", help_heading = STORE)]
    store: Option<PathBuf>,
}

impl StoreArguments {
    /// Returns the arguments for a given folder, or for the default one.
    pub fn of(store: Option<PathBuf>) -> Self {
        Self { store }
    }

    /// Returns the folder given on the command line.
    pub fn given(&self) -> Option<&Path> {
        self.store.as_deref()
    }

    /// Returns the folder of the store for a command without a pipeline.
    pub fn folder(&self) -> PathBuf {
        self.folder_for(None)
    }

    /// Returns the folder of the store for a pipeline.
    pub fn folder_of(&self, pipeline: &Path) -> PathBuf {
        self.folder_for(Some(pipeline))
    }

    /// Returns the folder of the store for the first reference that names a pipeline, as in `PIPELINE.yaml:STAGE`,
    /// `PIPELINE.yaml@RUN` or `FOLDER:STAGE`.
    pub fn folder_of_any<'a>(&self, references: impl IntoIterator<Item = &'a String>) -> PathBuf {
        let pipeline = |reference: &'a String| match reference.rsplit_once([':', '@']) {
            Some((folder, _)) if Path::new(folder).is_dir() => pipeline_in(PathBuf::from(folder)).ok(),
            Some((file, _)) => Some(PathBuf::from(file)),
            None => Some(PathBuf::from(reference)),
        };
        let mut files = references.into_iter().filter_map(pipeline);
        let found = files.find(|file| file.extension().is_some_and(|end| end == "yaml" || end == "yml"));
        self.folder_for(found.as_deref())
    }

    /// Returns the folder of the store for an optional pipeline.
    pub fn folder_for(&self, pipeline: Option<&Path>) -> PathBuf {
        let set = || std::env::var_os("DEAFLOW_STORE").filter(|value| !value.is_empty());
        self.store
            .clone()
            .or_else(|| set().map(PathBuf::from))
            .unwrap_or_else(|| project::store(pipeline))
    }
}

/// The heading of options that select one of several designs.
const WHICH: &str = "Which design";

/// Selects one of several designs.
#[derive(Clone, Debug, Args)]
pub struct DesignArguments {
    /// The target of the design [default: the only one]
    #[arg(long, value_name = "NAME", help_heading = WHICH)]
    design: Option<String>,
    /// The case of the target
    #[arg(long, value_name = "TEXT", help_heading = WHICH)]
    case: Option<String>,
    /// The role of the design [default: the first of these that exists]
    #[arg(long, value_parser = PossibleValuesParser::new(Role::ALL.map(Role::name)), help_heading = WHICH)]
    role: Option<String>,
    /// The number of the design among those of the target, from 1 as in runs and reports [default: the best by
    /// simulation,
    /// or the first]
    #[arg(long, value_name = "N", value_parser = integer::<u64>(1..=u64::MAX), help_heading = WHICH)]
    member: Option<u64>,
    /// The number of units along a side of the design; 50 if it was searched by single cells
    #[arg(long, value_name = "N", help_heading = WHICH)]
    units: Option<u64>,
}

impl DesignArguments {
    /// The names of the arguments.
    pub const NAMES: [&'static str; 5] = ["design", "case", "role", "member", "units"];

    /// Returns the filter.
    pub fn filter(&self) -> DesignFilter<'_> {
        DesignFilter {
            name: self.design.as_deref(),
            case: self.case.as_deref(),
            role: self.role.as_deref(),
            member: self.member.map(|number| number - 1),
            units: self.units,
        }
    }

    /// Returns the first argument that is given.
    pub fn given(&self) -> Option<&'static str> {
        let given = [
            self.design.is_some(),
            self.case.is_some(),
            self.role.is_some(),
            self.member.is_some(),
            self.units.is_some(),
        ];
        given
            .iter()
            .zip(Self::NAMES)
            .find_map(|(given, name)| given.then_some(name))
    }
}

#[derive(Clone, Debug, Args)]
pub struct StateArguments {
    /// Use only this state of the device
    #[arg(long, value_name = "NAME")]
    pub state: Option<String>,
}

impl StateArguments {
    /// Describes a scene by its file and state.
    #[must_use]
    pub fn described(&self, scene: &Path) -> String {
        let state = self
            .state
            .as_ref()
            .map_or_else(String::new, |state| format!(" in state {state}"));
        format!("scene {}{state}", scene.display())
    }

    /// Returns a scene in the requested state, or unchanged without one.
    ///
    /// # Errors
    /// When it has no such state.
    pub fn of(&self, scene: Scene) -> Result<Scene, CliError> {
        match &self.state {
            None => Ok(scene),
            Some(state) => scene
                .in_state(state)
                .map_err(|unknown| CliError::bad_input(unknown.to_string()).help(unknown.help())),
        }
    }
}

#[derive(Clone, Debug, Args)]
pub struct SetArguments {
    /// Override a value, such as stages.small.count=400 or scene.drive.voltage="5 kV"; scene=FILE replaces the scene
    #[arg(long = "set", value_name = "PATH=VALUE", help_heading = PIPELINE)]
    pub sets: Vec<String>,
    /// Allow a sweep of more than 1000 stages
    #[arg(long, help_heading = PIPELINE)]
    pub many: bool,
}

impl SetArguments {
    /// Parses the overrides.
    ///
    /// # Errors
    /// When one is invalid.
    pub fn overrides(&self) -> Result<Vec<Override>, CliError> {
        self.sets.iter().map(|set| Ok(Override::parse(set)?)).collect()
    }

    /// Returns the overrides for a process in any folder: the path of a scene is made absolute.
    pub fn with_absolute_paths(&self) -> Vec<String> {
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
    /// The pipeline: a YAML file, or a folder with exactly one [default: the current folder]
    #[arg(default_value = ".", hide_default_value = true, value_parser = pipeline_parser())]
    pub pipeline: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Stop after this stage
    #[arg(long, value_name = "STAGE", help_heading = PIPELINE)]
    pub until: Option<String>,
    #[command(flatten)]
    pub set: SetArguments,
    /// Rehash every file; ignore cached sizes and times. With --remote, fetch results that are there only
    #[arg(long, help_heading = STORE)]
    pub verify: bool,
    #[command(flatten)]
    pub remote: RemoteArguments,
}

/// Returns the parser of an argument that names a pipeline.
pub fn pipeline_parser() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(pipeline_in)
}

/// Returns the only pipeline of a folder; a path to a file unchanged.
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
            "{shown} is a store, not a pipeline; use `--store {shown}` for a store"
        )),
        [] => Err(format!("no pipeline (a YAML file with `stages:`) in {shown}")),
        several => {
            let names: Vec<String> = several.iter().map(|file| file.display().to_string()).collect();
            Err(format!("several pipelines in {shown}: {}", names.join(", ")))
        }
    }
}

/// The largest file that is searched for `stages:`, in bytes.
const MAX_PIPELINE: u64 = 16 << 20;

/// Whether a file is a pipeline, valid or not.
fn has_stages(file: &Path) -> bool {
    let text = read_bounded(file, MAX_PIPELINE).unwrap_or_default();
    text.split(|byte| *byte == b'\n')
        .any(|line| line.starts_with(b"stages:"))
}

impl PipelineArguments {
    /// Returns the folder of the store.
    pub fn store_folder(&self) -> PathBuf {
        self.store.folder_of(&self.pipeline)
    }

    /// The pipeline, its overrides and its store, quoted for a shell.
    pub fn shell_words(&self) -> String {
        let pair = |name: &str, value: &str| [name.to_owned(), value.to_owned()];
        let mut words = vec![self.pipeline.display().to_string()];
        words.extend(self.set.sets.iter().flat_map(|set| pair("--set", set)));
        words.extend(self.until.iter().flat_map(|until| pair("--until", until)));
        let store = self.store.given().map(|store| store.display().to_string());
        words.extend(store.iter().flat_map(|store| pair("--store", store)));
        let quoted = words.iter().map(|word| shlex::try_quote(word).unwrap_or_default());
        quoted.collect::<Vec<_>>().join(" ")
    }
}

#[derive(Clone, Debug, Default, Args)]
pub struct RemoteArguments {
    /// Use artifacts of this remote instead of building them; fetch them as needed [default: $DEAFLOW_REMOTE, or none]
    #[arg(long, value_name = "NAME", help_heading = STORE)]
    pub remote: Option<String>,
}

impl RemoteArguments {
    /// Returns the name of the remote: the argument, or that of the environment.
    pub fn name(&self) -> Option<String> {
        remote_name(self.remote.as_deref())
    }
}

/// Returns the name of a remote: the argument, or that of the environment.
pub fn remote_name(name: Option<&str>) -> Option<String> {
    let set = || std::env::var("DEAFLOW_REMOTE").ok().filter(|value| !value.is_empty());
    name.map(str::to_owned).or_else(set)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProgressForm {
    /// Plain lines
    Plain,
    /// One JSON document per line for each event
    Json,
    /// Warnings only
    None,
}

#[derive(Clone, Copy, Debug, Default, Args)]
pub struct ProgressArguments {
    /// Print only warnings and errors
    #[arg(short, long, help_heading = PROGRESS)]
    pub quiet: bool,
    /// How to show progress on stderr [default: bars on a terminal, plain lines elsewhere]
    #[arg(long, value_enum, value_name = "HOW", conflicts_with = "quiet", help_heading = PROGRESS)]
    progress: Option<ProgressForm>,
}

impl ProgressArguments {
    /// Returns how to show progress.
    pub fn mode(self) -> ProgressMode {
        match self.progress {
            _ if self.quiet => ProgressMode::Warnings,
            Some(ProgressForm::None) => ProgressMode::Warnings,
            Some(ProgressForm::Plain) => ProgressMode::Lines,
            Some(ProgressForm::Json) => ProgressMode::Json,
            None => ProgressMode::Bars,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, Args)]
pub struct VerbosityArguments {
    /// Print all results and a table of the stages
    #[arg(short, long, conflicts_with = "quiet", help_heading = PROGRESS)]
    pub verbose: bool,
    #[command(flatten)]
    pub progress: ProgressArguments,
}

/// The heading of options about drawings and pictures.
pub const DRAWINGS: &str = "Drawings and pictures";

/// The largest coordinate in mm at which the origin of a drawing may be placed.
const FARTHEST_ORIGIN: f64 = 1e9;

#[derive(Clone, Debug, Args)]
pub struct DrawingArguments {
    /// The layer of the electrodes in a drawing; several are the electrode groups in their order [default: layers named
    /// electrode or electrode_1, …; else the only layer with curves of DXF, all of SVG]
    #[arg(long = "layer", value_name = "NAME", help_heading = DRAWINGS)]
    layers: Vec<String>,
    /// The unit of lengths in a drawing: um, mm, cm, m or in [default: that of the file]
    #[arg(long, value_name = "UNIT", value_parser = drawing_unit, help_heading = DRAWINGS)]
    unit: Option<DrawingUnit>,
    /// Where the origin of a drawing lies on the membrane, measured from its lower left corner, as in "25 mm, 25 mm"
    /// [default: at that corner]
    #[arg(long, value_name = "X,Y", value_parser = origin, allow_hyphen_values = true, help_heading = DRAWINGS)]
    origin: Option<Coordinates>,
    /// The dark share from which on a cell of a picture is an electrode [default: 0.5]
    #[arg(long, value_name = "SHARE", value_parser = number(1e-3..=1.0, "0.001 to 1"), help_heading = DRAWINGS)]
    threshold: Option<f64>,
}

/// How drawn electrodes are followed.
#[derive(Clone, Copy, Debug, Args)]
pub struct EdgesArguments {
    /// How the edges of electrodes in drawings are followed: by cells, fitted, so that elements follow them, or
    /// coverage, the share of each cell that they, or the greys of a picture, cover
    #[arg(
        long,
        value_name = "EDGES",
        default_value = "cells",
        value_parser = edges,
        help_heading = DRAWINGS
    )]
    pub edges: Edges,
}

/// Parses how edges are followed.
fn edges(text: &str) -> Result<Edges, String> {
    Edges::from_name(text).ok_or_else(|| format!("allowed: {}", Edges::WORDS.join(", ")))
}

impl DrawingArguments {
    /// Returns how drawings are read.
    pub fn options(&self) -> DrawingOptions {
        let usual = DrawingOptions::default();
        DrawingOptions {
            layers: self.layers.clone(),
            unit_mm: self.unit.map(DrawingUnit::mm),
            origin_mm: self.origin.map_or(usual.origin_mm, Coordinates::mm),
            threshold: self.threshold.unwrap_or(usual.threshold),
            ..usual
        }
    }

    /// Adds to the notes on pictures without an electrode, or with nothing else, how light colours are read.
    pub fn with_hints(&self, mut named: NamedPatterns) -> NamedPatterns {
        let is_picture = |note: &str| PictureFormat::of(Path::new(note.split(": ").next().unwrap_or(note))).is_some();
        for note in &mut named.notes {
            let hint = match note.as_str() {
                bare if bare.ends_with("has no electrode") => "--threshold 0.05 reads light colours as electrode too",
                full if full.ends_with("is covered completely") => {
                    "--threshold 0.9 reads only dark colours as electrode"
                }
                _ => continue,
            };
            if self.threshold.is_none() && is_picture(note) {
                *note += &format!("; {hint}");
            }
        }
        named
    }
}

/// A point, measured from the lower left corner of the membrane.
#[derive(Clone, Copy, Debug)]
pub struct Coordinates([Quantity; 2]);

impl Coordinates {
    /// Returns x and y in mm.
    pub fn mm(self) -> [f64; 2] {
        self.0.map(|coordinate| coordinate.value())
    }
}

/// Parses a point.
pub fn coordinates(text: &str) -> Result<Coordinates, String> {
    let (x, y) = text
        .trim_matches(['[', ']'])
        .split_once(',')
        .ok_or("expected X,Y, as in \"25 mm, 25 mm\"")?;
    let length = |text: &str| quantity(text, Dimension::Length);
    Ok(Coordinates([length(x)?, length(y)?]))
}

/// Parses the place of the origin of a drawing.
fn origin(text: &str) -> Result<Coordinates, String> {
    let place = coordinates(text)?;
    match place.mm().into_iter().all(|mm| mm.abs() <= FARTHEST_ORIGIN) {
        true => Ok(place),
        false => Err(format!("allowed: -{FARTHEST_ORIGIN} to {FARTHEST_ORIGIN} mm")),
    }
}

/// Parses a unit of drawings.
fn drawing_unit(text: &str) -> Result<DrawingUnit, String> {
    DrawingUnit::from_name(text).ok_or_else(|| format!("allowed: {}", DrawingUnit::WORDS.join(", ")))
}

#[derive(Debug, Args)]
pub struct PatternArguments {
    /// Patterns: FILE.npy, FILE.csv, pictures FILE.png (also .jpg, .tif, .bmp), drawings FILE.dxf and FILE.svg, or
    /// FILE.h5:/dataset (also .mat, .nc, .npz)
    #[arg(value_name = "PATTERN", required = true)]
    pub patterns: Vec<String>,
    #[command(flatten)]
    pub drawings: DrawingArguments,
    /// The file for the results; an existing file is replaced [default: none, results are only printed]
    #[arg(short, long, value_name = "OUT.h5")]
    pub output: Option<PathBuf>,
}

/// The extensions of HDF5 files.
pub const HDF5: [&str; 2] = ["h5", "hdf5"];

/// Whether a path has the extension of an HDF5 file.
pub fn has_hdf5_extension(path: &Path) -> bool {
    path.extension()
        .is_some_and(|end| HDF5.iter().any(|known| end == *known))
}

impl PatternArguments {
    /// Reads the patterns.
    ///
    /// # Errors
    /// When one cannot be read.
    pub fn read(&self, form: PatternForm, edges: Edges) -> Result<NamedPatterns, InputError> {
        let drawings = DrawingOptions {
            edges,
            ..self.drawings.options()
        };
        Ok(self
            .drawings
            .with_hints(direct::patterns(&self.patterns, form, &drawings)?))
    }

    /// Refuses an output file with the extension of another format than HDF5.
    ///
    /// # Errors
    /// When it does.
    pub fn check_ending(&self) -> Result<(), CliError> {
        let Some((file, end)) = self.output.as_deref().and_then(|file| Some((file, file.extension()?))) else {
            return Ok(());
        };
        if has_hdf5_extension(file) {
            return Ok(());
        }
        let message = format!(
            "cannot write {}: the output is an HDF5 file, not .{}",
            file.display(),
            end.display()
        );
        Err(CliError::bad_input(message).help(
            "allowed: .h5 and .hdf5, as in -o out.h5; `deaflow show out.h5 --csv` prints its rows as CSV, `--corners` \
                 the displacement of each corner",
        ))
    }
}

/// The default relative residual at which an equilibrium is accepted.
pub const TOLERANCE: f64 = 1e-8;

/// How the numbers without a unit in options were read; a parser of clap has no other way to tell it.
static BARE_NUMBERS: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Parses a quantity in an option, and notes how a number without a unit is read.
pub fn quantity(text: &str, dimension: Dimension) -> Result<Quantity, String> {
    let text = text.trim();
    let read = Quantity::parse(text, dimension).map_err(|error| error.to_string())?;
    if read.is_bare_in(text) {
        let note = format!("{text} as {read}");
        let mut noted = BARE_NUMBERS.lock().unwrap_or_else(PoisonError::into_inner);
        if !noted.contains(&note) {
            noted.push(note);
        }
    }
    Ok(read)
}

/// Says how numbers without a unit in the options of this process were read; `None` if all have one.
pub fn bare_numbers() -> Option<String> {
    let noted = BARE_NUMBERS.lock().unwrap_or_else(PoisonError::into_inner);
    (!noted.is_empty()).then(|| format!("options without a unit were read in base units: {}", noted.join(", ")))
}

/// Parses an accuracy of the displacement, a length.
pub fn accuracy(text: &str) -> Result<Quantity, String> {
    let length = quantity(text, Dimension::Length)?;
    if (1e-9..=1e3).contains(&length.value()) {
        Ok(length)
    } else {
        Err("allowed: 1e-9 mm to 1000 mm".to_owned())
    }
}

#[derive(Debug, Args)]
pub struct TimeArguments {
    /// Limit of work per pattern, after which it ends as work-limit, as in "60 s" [default: 5 s, 500 s for a history].
    /// Work is counted instead of time, so that results do not depend on the machine: it takes about that time on
    /// 50 x 50 cells with one biquadratic element each, less on fewer cells and more on finer meshes
    #[arg(long, value_name = "TIME", value_parser = time_limit, allow_hyphen_values = true)]
    pub time_limit: Option<Time>,
}

impl TimeArguments {
    /// Returns the limit of work per pattern.
    pub fn work_limit(&self) -> WorkLimit {
        WorkLimit::of_time(self.time_limit.as_ref())
    }
}

/// Parses a duration, as in "5min" or "2 h".
pub fn duration(text: &str) -> Result<Duration, String> {
    let duration = humantime::parse_duration(text).map_err(|_| "allowed: a time such as \"90 min\" or 7days")?;
    if duration <= MAX_DURATION {
        Ok(duration)
    } else {
        Err("allowed: 0s to 366days".to_owned())
    }
}

/// Parses a time limit per pattern.
fn time_limit(text: &str) -> Result<Time, String> {
    let time = quantity(text, Dimension::Time)?;
    match Time::from_f64(time.value()) {
        Some(time) if (1e-3..=1e6).contains(&time.value()) => Ok(time),
        _ => Err("allowed: 1 ms to 1e6 s".to_owned()),
    }
}

/// Returns a parser of numbers in a range; `words` describes the range.
pub fn number(
    allowed: std::ops::RangeInclusive<f64>,
    words: &'static str,
) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        let value = text.parse::<f64>().ok().filter(|value| allowed.contains(value));
        value.ok_or_else(|| format!("allowed: {words}"))
    }
}

/// Returns a parser of integers in a range.
pub fn integer<T>(allowed: std::ops::RangeInclusive<u64>) -> impl Fn(&str) -> Result<T, String> + Clone
where
    T: TryFrom<u64>,
{
    move |text| {
        let value = text.trim().parse().ok().filter(|value| allowed.contains(value));
        let value = value.and_then(|value: u64| T::try_from(value).ok());
        value.ok_or_else(|| match (*allowed.start(), *allowed.end()) {
            (low, high) if high >= i64::MAX as u64 => format!("allowed: an integer from {low}"),
            (low, high) => format!("allowed: an integer from {low} to {high}"),
        })
    }
}

/// Parses an age: a duration, as in "90 min" or "7days", or a number of hours.
pub fn age(text: &str) -> Result<Duration, String> {
    match text.trim().parse::<f64>() {
        Ok(hours) if (0.0..=1e6).contains(&hours) => Ok(Duration::from_secs_f64(3600.0 * hours)),
        Ok(_) => Err("allowed: 0 to 1e6 hours".to_owned()),
        Err(_) => duration(text).map_err(|why| format!("{why}, or a number of hours")),
    }
}

/// Parses a size, as in "20GB" or "500 MB", in bytes.
pub fn size(text: &str) -> Result<u64, String> {
    const UNITS: [(&str, f64); 9] = [
        ("KiB", 1024.0),
        ("MiB", 1_048_576.0),
        ("GiB", 1_073_741_824.0),
        ("TiB", 1_099_511_627_776.0),
        ("kB", 1e3),
        ("MB", 1e6),
        ("GB", 1e9),
        ("TB", 1e12),
        ("B", 1.0),
    ];
    let text = text.trim();
    let found = UNITS
        .iter()
        .find_map(|(unit, size)| Some((text.strip_suffix(unit)?, size)));
    let bytes = found.and_then(|(number, size)| Some(number.trim().parse::<f64>().ok()? * size));
    match bytes.filter(|bytes| (1.0..=1e18).contains(bytes)) {
        Some(bytes) => Ok(bytes as u64),
        None => Err("allowed: a size such as 20GB or \"500 MB\", from 1 B to 1e6 TB".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_is_a_number_with_a_unit() {
        for (text, bytes) in [
            ("20GB", 20_000_000_000),
            ("500 MB", 500_000_000),
            ("1.5kB", 1500),
            ("7B", 7),
            ("2 TB", 2_000_000_000_000),
            ("1GiB", 1 << 30),
        ] {
            assert_eq!(size(text), Ok(bytes), "{text}");
        }
        for refused in ["20", "-1GB", "GB", "0B", "1e9TB", "NaN GB", "20 Gb", "20 apples", ""] {
            assert!(size(refused).is_err(), "{refused}");
        }
    }

    #[test]
    fn a_picture_without_an_electrode_gets_a_hint() {
        let hinted = |threshold: Option<f64>, note: &str| {
            let arguments = DrawingArguments {
                layers: Vec::new(),
                unit: None,
                origin: None,
                threshold,
            };
            let notes = vec![note.to_owned()];
            let named = NamedPatterns {
                notes,
                ..NamedPatterns::default()
            };
            arguments.with_hints(named).notes[0].contains("--threshold")
        };
        assert!(hinted(None, "red.png: the pattern has no electrode"));
        assert!(hinted(None, "red.png: the pattern is covered completely"));
        assert!(!hinted(Some(0.1), "red.png: the pattern has no electrode"));
        assert!(!hinted(None, "red.png: 100 × 100 pixels read by coverage"));
        assert!(!hinted(None, "red.csv: the pattern has no electrode"));
    }

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
    fn an_age_is_a_duration_or_hours() {
        for (text, seconds) in [
            ("0", 0),
            ("0s", 0),
            ("24", 86_400),
            ("0.5", 1800),
            ("90 min", 5400),
            ("7days", 604_800),
        ] {
            assert_eq!(age(text), Ok(Duration::from_secs(seconds)), "{text}");
        }
        for refused in ["-1", "1e9", "x", "NaN", "inf"] {
            assert!(age(refused).is_err(), "{refused}");
        }
    }

    #[test]
    fn numbers_have_bounds() {
        let tolerance = number(1e-12..=1e-3, "1e-12 to 1e-3");
        assert_eq!(tolerance("1e-8"), Ok(1e-8));
        for refused in ["0", "NaN", "1", "-1e-8", "x"] {
            assert_eq!(
                tolerance(refused),
                Err("allowed: 1e-12 to 1e-3".to_owned()),
                "{refused}"
            );
        }
        let order = integer::<u64>(1..=2);
        assert_eq!(order("2"), Ok(2));
        for refused in ["0", "3", "-1", "1.5", "x", ""] {
            assert_eq!(
                order(refused),
                Err("allowed: an integer from 1 to 2".to_owned()),
                "{refused}"
            );
        }
        assert_eq!(
            integer::<u8>(1..=u64::MAX)("300").unwrap_err(),
            "allowed: an integer from 1"
        );
    }
}
