//! What may stand on the command line.

mod export;

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, Parser, Subcommand, ValueEnum};

pub use export::{
    DesignFormat, DesignSize, ExportArguments, ExportDesignArguments, ExportModelArguments, Exported, ModelFormat,
};

use super::error::CliError;
use crate::base::{Dimension, Override, Quantity};
use crate::stage::direct::Method;
use crate::store::Store;

/// Designs dielectric-elastomer actuators, reproducibly: sample, solve, balance, train, design, verify.
#[derive(Debug, Parser)]
#[command(version, about, propagate_version = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build what is stale in a pipeline, then print what was found and where the figures are
    Run(RunArguments),
    /// Say what `run` would build, why, and what it would take; build nothing
    Plan(PipelineArguments),
    /// Say what is in a store, what is at work in it, and which pipelines are up to date
    Status(StatusArguments),
    /// Say why a stage would be built: every parameter and input that has changed
    Explain(ExplainArguments),
    /// Draw the stages of a pipeline and what they need
    Dag(DagArguments),
    /// Print the JSON Schema of pipelines or scenes, with which editors complete and check files
    Schema(SchemaArguments),
    /// Show what is in an artifact: datasets, statistics, provenance
    Show(ShowArguments),
    /// Check every byte of a store
    Fsck(FsckArguments),
    /// Remove artifacts that neither the last runs nor a pin nor a lock file need
    Gc(GcArguments),
    /// Keep an artifact, and all that it was made from, through every gc; without an artifact, list the pins
    Pin(PinArguments),
    /// Let gc take an artifact again
    Unpin(UnpinArguments),
    /// Say which effects a scene calls for, by number, threshold and cost
    Screen(ScreenArguments),
    /// Simulate patterns with finite elements
    Solve(SolveArguments),
    /// Predict the fields of patterns with a trained model
    Predict(PredictArguments),
    /// Write what was made in the formats of other programs
    Export(ExportArguments),
    /// Write a report of a pipeline: one page with every design, and the designs as files
    Report(ReportArguments),
    /// Measure what accuracy costs in a scene: error and time of methods and meshes
    Accuracy(AccuracyArguments),
    /// Check a dataset: provenance, values, symmetries, leaks, and every label against a simulation
    Audit(AuditArguments),
}

#[derive(Debug, Args)]
pub struct StoreArguments {
    /// The artifact store [default: $DEAFLOW_STORE, or else ./store]
    #[arg(long, value_name = "DIR")]
    store: Option<PathBuf>,
}

impl StoreArguments {
    /// The folder of the store.
    pub fn folder(&self) -> PathBuf {
        let set = || std::env::var_os("DEAFLOW_STORE").filter(|value| !value.is_empty());
        self.store
            .clone()
            .or_else(|| set().map(PathBuf::from))
            .unwrap_or_else(|| PathBuf::from("store"))
    }
}

#[derive(Debug, Args)]
pub struct PipelineArguments {
    /// The pipeline, a YAML file
    pub pipeline: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Stop after this stage
    #[arg(long, value_name = "STAGE")]
    pub until: Option<String>,
    /// Change a value for this run, such as stages.small.count=400 or scene.drive.voltage="5 kV"
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub sets: Vec<String>,
    /// Digest every file that is looked at, instead of believing sizes and times
    #[arg(long)]
    pub verify: bool,
    /// Threads to use [default: one per core]; results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Print one JSON document on stdout; progress goes to stderr either way
    #[arg(long)]
    pub json: bool,
}

impl PipelineArguments {
    /// The store as it is to be looked at.
    pub fn trust(&self, store: Store) -> Store {
        if self.verify { store.without_trust() } else { store }
    }

    /// The `--set` arguments, in order.
    ///
    /// # Errors
    /// When one cannot be read.
    pub fn overrides(&self) -> Result<Vec<Override>, CliError> {
        overrides(&self.sets)
    }
}

#[derive(Debug, Args)]
pub struct RunArguments {
    #[command(flatten)]
    pub of: PipelineArguments,
    /// When a stage fails, go on with all that does not need it
    #[arg(short, long)]
    pub keep_going: bool,
    /// Write the lock file beside the pipeline: the digest of everything that was built or reused
    #[arg(long, conflicts_with_all = ["until", "sets", "locked"])]
    pub lock: bool,
    /// Hold the pipeline to its lock file: any difference is an error, found before any work wherever it can be
    #[arg(long)]
    pub locked: bool,
    /// Say nothing but warnings and errors
    #[arg(short, long)]
    pub quiet: bool,
    /// How progress is shown on stderr [default: bars on a terminal, or else plain lines]
    #[arg(long, value_enum, value_name = "HOW", conflicts_with = "quiet")]
    pub progress: Option<ProgressForm>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProgressForm {
    /// Plain lines
    Plain,
    /// One JSON document per line for everything that happens
    Json,
    /// Warnings only
    None,
}

#[derive(Debug, Args)]
pub struct StatusArguments {
    /// Pipelines to look at [default: those of the last runs]
    #[arg(value_name = "PIPELINE")]
    pub pipelines: Vec<PathBuf>,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct ExplainArguments {
    /// The pipeline, a YAML file
    pub pipeline: PathBuf,
    /// The stage
    pub stage: String,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Change a value, as for `run`
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub sets: Vec<String>,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

impl ExplainArguments {
    /// The `--set` arguments, in order.
    ///
    /// # Errors
    /// When one cannot be read.
    pub fn overrides(&self) -> Result<Vec<Override>, CliError> {
        overrides(&self.sets)
    }
}

fn overrides(sets: &[String]) -> Result<Vec<Override>, CliError> {
    sets.iter().map(|set| Ok(Override::parse(set)?)).collect()
}

#[derive(Debug, Args)]
pub struct DagArguments {
    /// The pipeline, a YAML file
    pub pipeline: PathBuf,
    /// How to draw
    #[arg(long, value_enum, default_value_t = DagFormat::Text)]
    pub format: DagFormat,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum DagFormat {
    /// One line per stage
    Text,
    /// A Mermaid flow chart
    Mermaid,
    /// A Graphviz digraph
    Dot,
}

#[derive(Debug, Args)]
pub struct SchemaArguments {
    /// Of what
    #[arg(value_enum, default_value_t = SchemaOf::Pipeline)]
    pub of: SchemaOf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum SchemaOf {
    /// Pipelines
    Pipeline,
    /// Scenes in files of their own
    Scene,
}

#[derive(Debug, Args)]
pub struct ShowArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or at least its first 4 digits
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: String,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct FsckArguments {
    #[command(flatten)]
    pub store: StoreArguments,
    /// Make the store sound: also remove records of what is missing, manifests that lack chunks, and strays
    #[arg(long)]
    pub repair: bool,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct GcArguments {
    #[command(flatten)]
    pub store: StoreArguments,
    /// Say what would go, how large it is and what holds the rest; remove nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Keep what the last N runs made and needed
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub keep_runs: usize,
    /// Keep what was written less than so many hours ago
    #[arg(long, value_name = "HOURS", default_value_t = 24.0, value_parser = hours)]
    pub grace: f64,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct PinArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or at least its first 4 digits
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: Option<String>,
    /// Why it is kept
    #[arg(long, value_name = "TEXT", requires = "artifact")]
    pub label: Option<String>,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct UnpinArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or at least its first 4 digits
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: String,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct ScreenArguments {
    /// A scene, or a pipeline whose scene is meant; a YAML file
    pub scene: PathBuf,
    /// Patterns to judge by, FILE.npy, FILE.csv, FILE.png or FILE.h5:/dataset [default: extreme patterns]
    #[arg(value_name = "PATTERN")]
    pub patterns: Vec<String>,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct SolveArguments {
    /// A scene, or a pipeline whose scene is meant; a YAML file
    pub scene: PathBuf,
    #[command(flatten)]
    pub patterns: PatternArguments,
    /// How fields are found: newton, or as estimates that are no equilibria linear or chord:N (N chord steps)
    #[arg(long, value_name = "METHOD", default_value = "newton", value_parser = Method::from_str)]
    pub method: Method,
    /// Elements along one side of a cell [default: 2; 1 for a path]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=8))]
    elements_per_cell: Option<u64>,
    /// Polynomial order of the elements [default: 1; 2 for a path, because bilinear ones lose stability too late]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=2))]
    order: Option<u64>,
    /// Pick mesh and order for each pattern so that the displacement is this accurate, as in "0.005 mm"; the estimated
    /// error of each pattern is written too
    #[arg(long, value_name = "LENGTH", value_parser = accuracy, conflicts_with_all = ["elements_per_cell", "order"])]
    pub accuracy: Option<Quantity>,
    /// Relative residual at which an equilibrium is accepted [default: 1e-8]
    #[arg(long, value_name = "R", value_parser = tolerance)]
    pub tolerance: Option<f64>,
    /// Write stretches, field, stresses and tension of every cell too
    #[arg(long, conflicts_with_all = ["accuracy", "path"])]
    pub cells: bool,
    /// Follow each pattern from rest past the voltage at which it loses stability, whatever the voltage of the scene;
    /// OUT.csv and OUT.png are written beside OUT.h5
    #[arg(long, conflicts_with_all = ["accuracy"])]
    pub path: bool,
}

impl SolveArguments {
    /// Elements per cell and order of the mesh.
    pub fn mesh(&self) -> (u64, u64) {
        let (elements, order) = if self.path { (1, 2) } else { (2, 1) };
        (self.elements_per_cell.unwrap_or(elements), self.order.unwrap_or(order))
    }
}

#[derive(Debug, Args)]
pub struct PredictArguments {
    /// A digest or its beginning, a stage of the last run, PIPELINE.yaml:STAGE, or a file
    pub model: String,
    #[command(flatten)]
    pub patterns: PatternArguments,
    /// Refuse a model for another scene than this one, or than that of a pipeline; a YAML file
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    #[command(flatten)]
    pub store: StoreArguments,
}

#[derive(Debug, Args)]
pub struct ReportArguments {
    /// The pipeline, a YAML file
    pub pipeline: PathBuf,
    /// Folder for index.html, data/designs.csv and data/patterns/*.csv
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Report this stage and what it needs [default: all stages]
    #[arg(long, value_name = "STAGE")]
    pub until: Option<String>,
    /// Change a value, as for `run`
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub sets: Vec<String>,
    /// Report what is there, and say on the page what is not built
    #[arg(long)]
    pub partial: bool,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

impl ReportArguments {
    /// The `--set` arguments, in order.
    ///
    /// # Errors
    /// When one cannot be read.
    pub fn overrides(&self) -> Result<Vec<Override>, CliError> {
        overrides(&self.sets)
    }
}

#[derive(Debug, Args)]
pub struct AccuracyArguments {
    /// A scene, or a pipeline whose scene is meant; a YAML file
    pub scene: PathBuf,
    /// Measure on these patterns: FILE.npy, FILE.csv, FILE.png or FILE.h5:/dataset
    #[arg(long, value_name = "PATTERN", num_args = 1.., conflicts_with_all = ["families", "count", "seed"])]
    pub patterns: Vec<String>,
    /// Measure on patterns drawn from small grids, large grids, Bézier curves, stripes and single cells; the default
    #[arg(long)]
    pub families: bool,
    /// Patterns of each family
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub count: u64,
    /// Seed of the families
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = clap::value_parser!(u64).range(0..=i64::MAX as u64))]
    pub seed: u64,
    /// Folder for accuracy.h5, accuracy.csv and accuracy.png
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Name the cheapest setting whose largest displacement error stays below this, as in "0.01 mm"
    #[arg(long, value_name = "LENGTH", value_parser = accuracy)]
    pub target: Option<Quantity>,
    /// What to measure, as in "[linear, chord:1, { elements_per_cell: 4, order: 2 }, { accuracy: 0.01 mm },
    /// { model: FILE.safetensors }]"
    #[arg(long, value_name = "YAML")]
    pub methods: Option<String>,
    /// A trained model to measure too, named as for `predict`; may be given again
    #[arg(long, value_name = "MODEL")]
    pub model: Vec<String>,
    #[command(flatten)]
    pub store: StoreArguments,
    /// What to compare with
    #[arg(long, value_name = "YAML", default_value = "{ elements_per_cell: 8, order: 2 }")]
    pub reference: String,
    /// Threads for the reference [default: one per core]; methods are measured on one
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Print one JSON document on stdout; progress goes to stderr either way
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct AuditArguments {
    /// A stage, PIPELINE.yaml:STAGE, or a file in the layout of `deaflow solve`, which takes --scene
    #[arg(value_name = "PIPELINE:STAGE|FILE.h5")]
    pub dataset: String,
    /// The scene of the file, or a pipeline whose scene is meant; a YAML file
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Random rows to simulate on a finer mesh too, or all
    #[arg(long, value_name = "N|all", default_value = "32", value_parser = samples)]
    pub samples: Samples,
    /// Seed of the random choice
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=i64::MAX as u64))]
    pub seed: u64,
    /// The error that labels may have, as in "0.01 mm" [default: what the dataset declares]
    #[arg(long, value_name = "LENGTH", value_parser = accuracy)]
    pub accuracy: Option<Quantity>,
    /// Folder for a report: audit.html, with its figures in it
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Change a value of the pipeline, as for `run`
    #[arg(long = "set", value_name = "PATH=VALUE", conflicts_with = "scene")]
    pub sets: Vec<String>,
    /// Threads to use [default: one per core]; results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Print one JSON document on stdout; progress goes to stderr either way
    #[arg(long)]
    pub json: bool,
}

impl AuditArguments {
    /// The `--set` arguments, in order.
    ///
    /// # Errors
    /// When one cannot be read.
    pub fn overrides(&self) -> Result<Vec<Override>, CliError> {
        overrides(&self.sets)
    }
}

/// A number of rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Samples {
    /// So many at random.
    Random(u64),
    /// Every one.
    All,
}

fn samples(text: &str) -> Result<Samples, String> {
    if text == "all" {
        return Ok(Samples::All);
    }
    let number = text.parse::<u64>().ok().filter(|n| *n <= 100_000_000);
    number
        .map(Samples::Random)
        .ok_or_else(|| "allowed: 0 to 100000000, or all".to_owned())
}

#[derive(Debug, Args)]
pub struct PatternArguments {
    /// FILE.npy, FILE.csv, FILE.png or FILE.h5:/dataset
    #[arg(value_name = "PATTERN", required = true)]
    pub patterns: Vec<String>,
    /// Where the result goes; an existing file is replaced
    #[arg(short, long, value_name = "OUT.h5")]
    pub output: PathBuf,
    /// Threads to use [default: one per core]; results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Print one JSON document on stdout; progress goes to stderr either way
    #[arg(long)]
    pub json: bool,
}

fn accuracy(text: &str) -> Result<Quantity, String> {
    let length = Quantity::parse(text, Dimension::Length).map_err(|e| e.to_string())?;
    if (1e-9..=1e3).contains(&length.value()) {
        Ok(length)
    } else {
        Err("allowed: 1e-9 mm to 1000 mm".to_owned())
    }
}

/// Relative residual at which an equilibrium is accepted unless said otherwise.
pub const TOLERANCE: f64 = 1e-8;

fn hours(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().map_err(|e| e.to_string())?;
    if (0.0..=1e6).contains(&value) {
        Ok(value)
    } else {
        Err("allowed: 0 to 1e6 hours".to_owned())
    }
}

fn tolerance(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().map_err(|e| e.to_string())?;
    let allowed = 1e-12..=1e-3;
    if allowed.contains(&value) {
        Ok(value)
    } else {
        Err("allowed: 1e-12 to 1e-3".to_owned())
    }
}

impl Command {
    /// Whether one JSON document is wanted.
    pub fn json(&self) -> bool {
        match self {
            Self::Run(a) => a.of.json,
            Self::Plan(a) => a.json,
            Self::Status(a) => a.json,
            Self::Explain(a) => a.json,
            Self::Dag(_) | Self::Schema(_) => false,
            Self::Show(a) => a.json,
            Self::Fsck(a) => a.json,
            Self::Gc(a) => a.json,
            Self::Pin(a) => a.json,
            Self::Unpin(a) => a.json,
            Self::Screen(a) => a.json,
            Self::Solve(a) => a.patterns.json,
            Self::Predict(a) => a.patterns.json,
            Self::Export(a) => match &a.what {
                Exported::Design(a) => a.json,
                Exported::Model(a) => a.json,
            },
            Self::Report(a) => a.json,
            Self::Accuracy(a) => a.json,
            Self::Audit(a) => a.json,
        }
    }

    /// The number of threads, where it is given.
    pub fn jobs(&self) -> Option<u16> {
        match self {
            Self::Run(a) => a.of.jobs,
            Self::Plan(a) => a.jobs,
            Self::Solve(a) => a.patterns.jobs,
            Self::Predict(a) => a.patterns.jobs,
            Self::Accuracy(a) => a.jobs,
            Self::Audit(a) => a.jobs,
            Self::Status(_)
            | Self::Explain(_)
            | Self::Dag(_)
            | Self::Schema(_)
            | Self::Show(_)
            | Self::Fsck(_)
            | Self::Gc(_)
            | Self::Pin(_)
            | Self::Unpin(_)
            | Self::Export(_)
            | Self::Report(_)
            | Self::Screen(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_declaration_holds_together() {
        Cli::command().debug_assert();
    }

    #[test]
    fn tolerances_have_bounds() {
        assert_eq!(tolerance("1e-8"), Ok(1e-8));
        for refused in ["0", "NaN", "1", "-1e-8", "x"] {
            assert!(tolerance(refused).is_err(), "{refused}");
        }
    }
}
