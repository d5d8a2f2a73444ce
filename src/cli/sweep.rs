//! `deaflow sweep`: a pipeline for each combination of some values, without editing its file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use clap::Args;

use super::arguments::{PIPELINE, PROGRESS, PipelineArguments, SetArguments, StoreArguments};
use super::cluster::ClusterArguments;
use super::error::CliError;
use super::examples::examples;
use super::output::{Exit, Output};
use super::run::{self, ProgressForm, RunArguments};
use super::upstream::RemoteArguments;
use super::{csv, plan, solve, write};
use deaflow_base::{ArtifactId, Document, Node, NodeValue, Override};
use deaflow_content::Table;
use deaflow_orchestrator::StageReport;
use deaflow_report::Collected;
use deaflow_stage as stage;
use deaflow_store::{Command, Store};

/// The heading of options about the table.
const TABLES: &str = "Table";

/// Name of the stage that collects.
const TABLE: &str = "sweep";

/// Run a pipeline for each combination of some values, and collect results in a table
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow sweep pipeline.yaml --set scene.drive.voltage=\"4 kV, 5 kV\" --table max_displacement"))]
pub struct SweepArguments {
    /// The pipeline, a YAML file
    pub pipeline: PathBuf,
    /// Values of a field, with commas between them, such as scene.drive.voltage="3 kV, 4 kV"; several fields multiply. One
    /// value alone is a change as in `run`
    #[arg(long = "set", value_name = "PATH=VALUES", required = true, help_heading = PIPELINE)]
    pub sets: Vec<String>,
    /// Results to collect beside the values, with commas between them: STAGE.RESULT, or RESULT of the last stage; the names
    /// are those of `deaflow log`
    #[arg(long, value_name = "RESULTS", value_delimiter = ',', help_heading = TABLES)]
    pub table: Vec<String>,
    /// What a figure shows: the columns of x and y and, for a curve for each of its values, a third
    #[arg(
        long,
        value_name = "X,Y[,SERIES]",
        value_delimiter = ',',
        requires = "table",
        num_args = 1,
        help_heading = TABLES
    )]
    pub plot: Vec<String>,
    /// Print the table in CSV and nothing else
    #[arg(long, requires = "table", conflicts_with = "json", help_heading = TABLES)]
    pub csv: bool,
    /// Write the table as a CSV file; an existing file is replaced
    #[arg(short, long, value_name = "FILE.csv", requires = "table", help_heading = TABLES)]
    pub output: Option<PathBuf>,
    /// Allow more than 1000 stages
    #[arg(long, help_heading = PIPELINE)]
    pub many: bool,
    #[command(flatten)]
    pub store: StoreArguments,
    #[command(flatten)]
    pub remote: RemoteArguments,
    /// Say what would be built, as `plan` does; build nothing
    #[arg(short = 'n', long, conflicts_with_all = ["csv", "output"])]
    pub dry_run: bool,
    /// When a stage fails, go on with all that does not need it
    #[arg(short, long)]
    pub keep_going: bool,
    /// Print all that was found, and a table of the stages
    #[arg(short, long, help_heading = PROGRESS)]
    pub verbose: bool,
    /// Say nothing but warnings and errors
    #[arg(short, long, conflicts_with = "verbose", help_heading = PROGRESS)]
    pub quiet: bool,
    /// How progress is shown on stderr [default: bars on a terminal, or else plain lines]
    #[arg(long, value_enum, value_name = "HOW", conflicts_with = "quiet", help_heading = PROGRESS)]
    pub progress: Option<ProgressForm>,
}

pub fn execute(arguments: &SweepArguments, output: &Output) -> Result<Exit, CliError> {
    let file = Document::load(&arguments.pipeline)?;
    let swept = Swept::read(arguments, &file.root)?;
    if let Some(file) = &arguments.output {
        solve::check_not_read(file, &[arguments.pipeline.to_string_lossy().as_ref()])?;
        write::check_csv(file)?;
    }
    let mut pipeline = run::load_file(&arguments.pipeline, &swept.overrides()?, arguments.many)?;
    // The history tells what was asked for, not how it was put into the tree.
    pipeline.overrides = arguments.sets.iter().filter_map(|set| said(set)).collect();
    let keep = |store: &Store, stages: &[StageReport]| match &arguments.output {
        // Before anything is printed: whoever reads that may have read enough.
        Some(file) => keep(
            file,
            &pipeline.name,
            collected(&store.clone().guarded(), stages, &swept.table)?,
        ),
        None => Ok(()),
    };
    let run = RunArguments {
        of: PipelineArguments {
            pipeline: arguments.pipeline.clone(),
            store: arguments.store.clone(),
            until: (!arguments.table.is_empty()).then(|| swept.table.clone()),
            set: SetArguments {
                sets: Vec::new(),
                many: arguments.many,
            },
            verify: false,
            remote: arguments.remote.clone(),
        },
        dry_run: arguments.dry_run,
        keep_going: arguments.keep_going,
        lock: false,
        locked: false,
        verbose: arguments.verbose && !arguments.csv,
        quiet: arguments.quiet || arguments.csv,
        progress: arguments.progress,
        cluster: ClusterArguments::default(),
    };
    if run.dry_run {
        return plan::of_pipeline(&pipeline, &run.of, output);
    }
    let (exit, stages) = run::of_pipeline(&pipeline, &run, Command::Sweep, output, &keep)?;
    if arguments.csv {
        let store = Store::open_existing(&arguments.store.folder_of(&arguments.pipeline))?.guarded();
        if let Some((_, text)) = collected(&store, &stages, &swept.table)? {
            output.plain(&text)?;
        }
    }
    Ok(exit)
}

fn keep(file: &Path, pipeline: &str, table: Option<(ArtifactId, String)>) -> Result<(), CliError> {
    let Some((digest, text)) = table else { return Ok(()) };
    let title = format!("{pipeline}: table of a sweep");
    write::csv(file, text.as_bytes(), &title, &digest.to_string())
}

/// Path and values of a `--set` as they were given.
fn said(set: &str) -> Option<(String, String)> {
    let (path, values) = set.split_once('=')?;
    Some((path.trim().to_owned(), values.trim().to_owned()))
}

/// The table in CSV, with its digest; none where a failure kept it from being made.
fn collected(store: &Store, stages: &[StageReport], name: &str) -> Result<Option<(ArtifactId, String)>, CliError> {
    let digest = stages
        .iter()
        .find(|stage| stage.name == name)
        .and_then(|stage| stage.digest);
    let Some(digest) = digest else { return Ok(None) };
    let artifact = store.artifact(&digest)?;
    let table = Table::read(&artifact)?;
    Ok(Some((digest, csv::of_table(&Collected::new(table))?)))
}

/// What is to be changed in the tree of the pipeline.
struct Swept<'a> {
    arguments: &'a SweepArguments,
    root: &'a Node,
    /// Axes with their values in YAML, by the stages that have them.
    axes: BTreeMap<String, Vec<(String, String)>>,
    /// Names of the axes in the order of the command line.
    names: Vec<String>,
    /// Changes of single values, and of values to axes.
    changes: Vec<String>,
    /// Name of the stage that collects.
    table: String,
    /// The fields that have been given.
    paths: BTreeSet<Vec<String>>,
}

impl<'a> Swept<'a> {
    fn read(arguments: &'a SweepArguments, root: &'a Node) -> Result<Self, CliError> {
        let has = |name: &str| root.peek("stages").is_some_and(|stages| stages.peek(name).is_some());
        let mut table = TABLE.to_owned();
        while has(&table) {
            table += "-table";
        }
        let mut swept = Self {
            arguments,
            root,
            axes: BTreeMap::new(),
            names: Vec::new(),
            changes: Vec::new(),
            table,
            paths: BTreeSet::new(),
        };
        for set in &arguments.sets {
            swept.add(set)?;
        }
        if swept.names.is_empty() {
            return Err(CliError::bad_input("no field has more than one value")
                .help("write them with commas: --set scene.drive.voltage=\"3 kV, 4 kV\""));
        }
        Ok(swept)
    }

    fn add(&mut self, set: &str) -> Result<(), CliError> {
        // A list says what a set cannot: whether there is one value or several.
        let (path, values) = said(set).unwrap_or((set.to_owned(), String::new()));
        let parsed = Override::parse(&format!("{path}=[{values}]"))?;
        let one = match parsed.value() {
            NodeValue::List(items) => items.len() < 2,
            _ => true,
        };
        let steps = parsed.path();
        if !self.paths.insert(steps.to_vec()) {
            return Err(CliError::bad_input(format!("--set {path} is given twice"))
                .help("give all values in one: --set PATH=VALUE,VALUE"));
        }
        if one {
            self.changes.push(set.to_owned());
            return Ok(());
        }
        let stages = self.stages_of(steps, set)?;
        let axis = self.axis(steps);
        self.changes.push(format!("{path}=\"${{{axis}}}\""));
        for stage in stages {
            self.axes
                .entry(stage)
                .or_default()
                .push((axis.clone(), format!("[{values}]")));
        }
        self.names.push(axis);
        Ok(())
    }

    /// The stages that get an axis: that of the field, or all that depend on the scene.
    fn stages_of(&self, path: &[String], set: &str) -> Result<Vec<String>, CliError> {
        match path {
            [scene, _, ..] if scene == "scene" => {
                let reads = self.readers_of_scene();
                match reads.is_empty() {
                    false => Ok(reads),
                    true => Err(CliError::bad_input(format!(
                        "--set {set}: no stage depends on the scene"
                    ))),
                }
            }
            [stages, name, _, ..] if stages == "stages" => Ok(vec![name.clone()]),
            _ => Err(
                CliError::bad_input(format!("--set {set}: only the scene and values of stages can be swept"))
                    .help("write it as scene.SECTION.FIELD=… or stages.NAME.FIELD=…"),
            ),
        }
    }

    fn readers_of_scene(&self) -> Vec<String> {
        let kinds = stage::registry().kinds;
        let reads = |node: &Node| {
            let kind = node.peek("kind").and_then(|kind| kind.text("kind").ok());
            kinds
                .iter()
                .any(|known| Some(known.name()) == kind && known.reads_scene())
        };
        let readers = self.stages().into_iter().filter(|(_, node)| reads(node));
        readers.map(|(name, _)| name.to_owned()).collect()
    }

    /// The last step of a path names its axis; where that is taken, as many steps as are needed.
    fn axis(&self, path: &[String]) -> String {
        let names = (1..=path.len()).map(|n| path[path.len() - n..].join("_"));
        let mut free = names.filter(|name| !self.names.contains(name));
        free.next()
            .unwrap_or_else(|| format!("{}_{}", path.join("_"), self.names.len()))
    }

    /// The overrides that make the sweep.
    fn overrides(&self) -> Result<Vec<Override>, CliError> {
        let mut sets = self.changes.clone();
        for (stage, axes) in &self.axes {
            let own = self.root.peek("stages").and_then(|stages| stages.peek(stage));
            if own.is_some_and(|own| own.peek("foreach").is_some()) {
                sets.extend(
                    axes.iter()
                        .map(|(axis, values)| format!("stages.{stage}.foreach.{axis}={values}")),
                );
            } else {
                let axes: Vec<String> = axes.iter().map(|(axis, values)| format!("{axis}: {values}")).collect();
                sets.push(format!("stages.{stage}.foreach={{ {} }}", axes.join(", ")));
            }
        }
        if !self.arguments.table.is_empty() {
            sets.push(self.table_stage()?);
        }
        sets.iter().map(|set| Ok(Override::parse(set)?)).collect()
    }

    /// The stage that collects, as an override.
    fn table_stage(&self) -> Result<String, CliError> {
        let results: Vec<&str> = self.arguments.table.iter().map(|name| name.trim()).collect();
        let names: BTreeSet<&str> = self.stages().into_iter().map(|(name, _)| name).collect();
        let mut needs: Vec<&str> = Vec::new();
        for result in &results {
            let named = result
                .split_once('.')
                .map(|(stage, _)| stage)
                .filter(|stage| names.contains(stage));
            let stages = named.map_or_else(|| self.last_stages(), |stage| vec![stage]);
            for stage in stages {
                if !needs.contains(&stage) {
                    needs.push(stage);
                }
            }
        }
        let quoted = |words: &[&str]| {
            words
                .iter()
                .map(|word| format!("{word:?}"))
                .collect::<Vec<_>>()
                .join(", ")
        };
        let mut columns: Vec<&str> = self.names.iter().map(String::as_str).collect();
        columns.extend(
            results
                .iter()
                .filter(|result| !self.names.iter().any(|name| name == *result)),
        );
        let plot = match &self.arguments.plot[..] {
            [] => String::new(),
            [x, y] => format!(", plot: {{ x: {x:?}, y: {y:?} }}"),
            [x, y, series] => format!(", plot: {{ x: {x:?}, y: {y:?}, series: {series:?} }}"),
            other => {
                let message = format!("--plot has {} columns", other.len());
                return Err(CliError::bad_input(message).help("write it as X,Y or X,Y,SERIES"));
            }
        };
        Ok(format!(
            "stages.{}={{ kind: table, needs: [{}], columns: [{}]{plot} }}",
            self.table,
            quoted(&needs),
            quoted(&columns)
        ))
    }

    /// The stages of the file by their names.
    fn stages(&self) -> Vec<(&'a str, &'a Node)> {
        let stages = self.root.peek("stages");
        let entries = stages.and_then(|stages| stages.entries("stages").ok());
        let entries = entries.unwrap_or_default().iter();
        entries
            .filter_map(|(key, node)| Some((key.text("a name").ok()?, node)))
            .collect()
    }

    /// The stages that no other needs. What a table collects is a result; the table itself has none.
    fn last_stages(&self) -> Vec<&'a str> {
        let is_table = |node: &Node| node.peek("kind").is_some_and(|kind| kind.is_text("table"));
        let mut stages = self.stages();
        stages.retain(|(_, node)| !is_table(node));
        let needs = stages
            .iter()
            .filter_map(|(_, node)| node.peek("needs")?.list("needs").ok());
        let needed: BTreeSet<&str> = needs.flatten().filter_map(|need| need.text("needs").ok()).collect();
        let names = stages.iter().map(|(name, _)| *name);
        names.filter(|name| !needed.contains(name)).collect()
    }
}
