//! `deaflow sweep`: runs a pipeline for each combination of values, without editing its file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use clap::Args;

use super::arguments::{
    PIPELINE, PipelineArguments, RemoteArguments, SetArguments, StoreArguments, VerbosityArguments, pipeline_parser,
};
use super::local_build::{Build, BuildResult, LockMode};
use super::pipeline::load_file;
use super::text::Text;
use super::{CliError, Exit, Output, csv, plan, table, write};
use deaflow_base::{ArtifactId, CsvColumn, Document, Node, NodeValue, Override};
use deaflow_content::Table;
use deaflow_orchestrator::{Pipeline, StageReport, WITHOUT};
use deaflow_report::{ResultTable, figure_files};
use deaflow_stage as stage;
use deaflow_store::{Command, RunStage, Store};

/// The heading of options about the table.
const TABLES: &str = "Table";

/// The most rows of the table that are printed.
const MOST_ROWS: usize = 24;

/// The name of the stage that collects the results.
const TABLE: &str = "sweep";

/// Run a pipeline for each combination of values and collect results in a table
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow sweep pipeline.yaml --set scene.drive.voltage=\"4 kV, 5 kV\" --table max_displacement"
))]
pub struct SweepArguments {
    /// The pipeline: a YAML file, or a folder with exactly one [default: the current folder]
    #[arg(default_value = ".", hide_default_value = true, value_parser = pipeline_parser())]
    pub pipeline: PathBuf,
    /// Comma-separated values of a field, such as scene.drive.voltage="3 kV, 4 kV"; values of several fields are
    /// combined.
    /// A single value overrides as in `run`
    #[arg(long = "set", value_name = "PATH=VALUES", required = true, help_heading = PIPELINE)]
    pub sets: Vec<String>,
    /// Stop after this stage, or all stages of its sweep
    #[arg(long, value_name = "STAGE", help_heading = PIPELINE)]
    pub until: Option<String>,
    /// Comma-separated results to collect: STAGE.RESULT, or RESULT of the last stage or that of --until, named as in
    /// `deaflow log`; with several last stages that have it, each is a column STAGE.RESULT
    #[arg(long, value_name = "RESULTS", value_delimiter = ',', help_heading = TABLES)]
    pub table: Vec<String>,
    /// Columns of a figure: x, y and, for one curve per value, a third
    #[arg(
        long,
        value_name = "X,Y[,SERIES]",
        value_delimiter = ',',
        requires = "table",
        num_args = 1,
        help_heading = TABLES
    )]
    pub plot: Vec<String>,
    /// Print only the table, as CSV
    #[arg(long, requires = "table", conflicts_with = "json", help_heading = TABLES)]
    pub csv: bool,
    /// Write the table to a CSV file; an existing file is replaced
    #[arg(short, long, value_name = "FILE.csv", requires = "table", help_heading = TABLES)]
    pub output: Option<PathBuf>,
    /// Allow more than 1000 stages
    #[arg(long, help_heading = PIPELINE)]
    pub many: bool,
    #[command(flatten)]
    pub store: StoreArguments,
    #[command(flatten)]
    pub remote: RemoteArguments,
    /// Print what would be built, as `plan` does; build nothing
    #[arg(short = 'n', long, conflicts_with_all = ["csv", "output"])]
    pub dry_run: bool,
    /// After a failure, build all stages that do not need the failed one
    #[arg(short, long)]
    pub keep_going: bool,
    #[command(flatten)]
    pub verbosity: VerbosityArguments,
}

pub fn execute(arguments: &SweepArguments, output: &Output) -> Result<Exit, CliError> {
    let file = Document::load(&arguments.pipeline)?;
    if file.root.peek("stages").is_none() {
        // A scene is refused as by `run`.
        load_file(&arguments.pipeline, &[], arguments.many)?;
    }
    let sweep = SweepPlan::read(arguments, &file.root)?;
    if let Some(file) = &arguments.output {
        write::check_not_read(file, &[arguments.pipeline.to_string_lossy()])?;
        write::check_csv(file)?;
    }
    let mut pipeline = load_file(&arguments.pipeline, &sweep.overrides()?, arguments.many)?;
    // The history records the command line instead of the overrides that it was turned into.
    pipeline.overrides = arguments.sets.iter().filter_map(|set| split_set(set)).collect();
    let of = PipelineArguments {
        pipeline: arguments.pipeline.clone(),
        store: arguments.store.clone(),
        until: sweep.until(),
        set: SetArguments {
            sets: Vec::new(),
            many: arguments.many,
        },
        verify: false,
        remote: arguments.remote.clone(),
    };
    if arguments.dry_run {
        return plan::print(&pipeline, &of, output);
    }
    let mut verbosity = arguments.verbosity;
    if arguments.csv {
        (verbosity.verbose, verbosity.progress.quiet) = (false, true);
    }
    let build = Build {
        pipeline: &pipeline,
        of: &of,
        command: Command::Sweep,
        keep_going: arguments.keep_going,
        lock: LockMode::Ignore,
        verbosity,
    };
    let complete = match build.run(output)? {
        BuildResult::Incomplete(exit) => return Ok(exit),
        BuildResult::Complete(complete) => complete,
    };
    let table = collected(&complete.store().clone().guarded(), complete.stages(), &sweep.table)?;
    // Before anything is printed: a reader may close stdout.
    if let (Some(file), Some(table)) = (&arguments.output, &table) {
        let title = format!("{}: table of a sweep", pipeline.name);
        let origin = (title.as_str(), &*table.digest.to_string());
        write::csv_of(file, table.text.as_bytes(), origin, table.columns.clone())?;
    }
    let store = complete.store().clone();
    let exit = complete.report(output)?;
    match table {
        Some(table) if arguments.csv => output.plain(&table.text)?,
        Some(table) if !output.is_json() && !verbosity.progress.quiet => {
            output.text(arguments.told(&table, &store, (&pipeline, &sweep.table)))?;
        }
        _ => {}
    }
    Ok(exit)
}

impl SweepArguments {
    /// Tells what was asked for: the table, unless the details have it, and the files of the table and the figure.
    fn told(&self, table: &Collected, store: &Store, (pipeline, stage): (&Pipeline, &str)) -> Text {
        let mut text = Text::new();
        if !self.verbosity.verbose {
            let rows = table.table.rows.len();
            text.line(table.table.text(MOST_ROWS));
            if rows > MOST_ROWS {
                let more = table::counted((rows - MOST_ROWS) as u64, "more rows");
                text.line(format!("and {more}: --csv prints all"));
            }
        }
        let digest = table.digest.to_string();
        let figures = figure_files(store, &pipeline.file(), &pipeline.name, stage, &digest);
        let missing = table.table.missing().into_iter();
        let written = self
            .output
            .iter()
            .map(|file| format!("table: {}", write::with_metadata(file)));
        let drawn = figures.iter().map(|figure| format!("figure: {}", figure.display()));
        missing.chain(written).chain(drawn).for_each(|line| {
            text.line(line);
        });
        text
    }
}

/// Splits an argument of `--set` into path and values.
fn split_set(set: &str) -> Option<(String, String)> {
    let (path, values) = set.split_once('=')?;
    Some((path.trim().to_owned(), values.trim().to_owned()))
}

/// The table that a sweep has collected.
struct Collected {
    digest: ArtifactId,
    table: ResultTable,
    /// The table as CSV.
    text: String,
    columns: Vec<CsvColumn>,
}

/// The collected table; none if none was requested.
fn collected(store: &Store, stages: &[StageReport], name: &str) -> Result<Option<Collected>, CliError> {
    let digest = stages
        .iter()
        .find(|stage| stage.name == name)
        .and_then(|stage| stage.digest);
    let Some(digest) = digest else { return Ok(None) };
    let artifact = store.artifact(&digest)?;
    let table = ResultTable::new(Table::read(&artifact)?);
    let column = |(title, unit): (String, &String)| CsvColumn {
        title,
        unit: Some(unit.clone()).filter(|unit| !unit.is_empty()),
    };
    Ok(Some(Collected {
        digest,
        text: csv::of_table(&table)?,
        columns: csv::titles(&table).into_iter().zip(&table.units).map(column).collect(),
        table,
    }))
}

/// Returns the names of the axes of a stage in a file: the keys of `foreach`, and of its pairs.
fn axes_of(stage: &Node) -> Vec<String> {
    let keys = Node::keys;
    let Some(foreach) = stage.peek("foreach") else {
        return Vec::new();
    };
    let pairs = foreach.peek(ZIP).map_or_else(Vec::new, |zip| match zip.value() {
        NodeValue::List(items) => items.iter().flat_map(keys).collect(),
        _ => keys(zip),
    });
    let own = keys(foreach).into_iter().filter(|axis| axis != ZIP);
    own.chain(pairs).collect()
}

/// The key of axes whose values are paired.
const ZIP: &str = "zip";

/// Whether a stage of a sweep was added by the command: the table that collects the results.
pub fn is_added(stage: &RunStage) -> bool {
    let rest = stage.name.strip_prefix(TABLE);
    stage.kind == "table" && rest.is_some_and(|rest| rest.replace("-table", "").is_empty())
}

/// The overrides that turn a pipeline into a sweep.
struct SweepPlan<'a> {
    arguments: &'a SweepArguments,
    root: &'a Node,
    /// Axes with the lists of their values, by stage.
    axes: BTreeMap<String, Vec<(String, Node)>>,
    /// Names of the axes, in the order of the command line.
    names: Vec<String>,
    /// Overrides of single values, and of values by axes.
    changes: Vec<Override>,
    /// The name of the stage that collects the results.
    table: String,
    /// The fields that have been set.
    paths: BTreeSet<Vec<String>>,
}

impl<'a> SweepPlan<'a> {
    fn read(arguments: &'a SweepArguments, root: &'a Node) -> Result<Self, CliError> {
        let has = |name: &str| root.peek("stages").is_some_and(|stages| stages.peek(name).is_some());
        let mut table = TABLE.to_owned();
        while has(&table) {
            table += "-table";
        }
        let mut plan = Self {
            arguments,
            root,
            axes: BTreeMap::new(),
            names: Vec::new(),
            changes: Vec::new(),
            table,
            paths: BTreeSet::new(),
        };
        for set in &arguments.sets {
            plan.add(set)?;
        }
        if plan.names.is_empty() {
            let list = arguments.sets.iter().find_map(|set| {
                let (path, values) = split_set(set)?;
                let values = values.strip_prefix('[')?.strip_suffix(']')?.trim();
                Some(format!("{path}=\"{values}\""))
            });
            return Err(match list {
                Some(without) => {
                    CliError::bad_input("no field has more than one value: a list in brackets is one value").help(
                        format!("without brackets each is a value of the sweep: --set {without}"),
                    )
                }
                None => CliError::bad_input("no field has more than one value")
                    .help("separate values by commas: --set scene.drive.voltage=\"3 kV, 4 kV\""),
            });
        }
        Ok(plan)
    }

    fn add(&mut self, set: &str) -> Result<(), CliError> {
        // Parsed as a list, to tell one value from several.
        let Some((path, _)) = split_set(set) else {
            return Err(CliError::bad_input(format!("--set {set}: '=' is missing"))
                .help("write it as --set PATH=VALUE,VALUE, such as --set scene.drive.voltage=\"3 kV, 4 kV\""));
        };
        let parsed = Override::of_values(set)?;
        let one = match parsed.value() {
            NodeValue::List(items) => items.len() < 2,
            _ => true,
        };
        let steps = parsed.path();
        if !self.paths.insert(steps.to_vec()) {
            return Err(CliError::bad_input(format!("--set {path} is given twice"))
                .help("combine the values: --set PATH=VALUE,VALUE"));
        }
        if self.is_of_unknown_stage(steps) {
            parsed.apply(&mut self.root.clone())?;
        }
        if one {
            self.changes.push(Override::parse(set)?);
            return Ok(());
        }
        let stages = self.stages_of(steps, set)?;
        let axis = self.axis(steps);
        // Messages quote the values as they are given, not the axis.
        let of_axis = Override::parse(&format!("{path}=\"${{{axis}}}\""))?;
        self.changes.push(of_axis.quoting(&parsed));
        for stage in stages {
            self.axes
                .entry(stage)
                .or_default()
                .push((axis.clone(), parsed.node().clone()));
        }
        self.names.push(axis);
        Ok(())
    }

    /// Returns the stages that get an axis: that of the field, or all that depend on the scene.
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
                    .help("expected scene.SECTION.FIELD=… or stages.NAME.FIELD=…"),
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

    /// Names an axis after the last step of a path, or as many steps as are needed for a free name that begins with a
    /// letter: the index of an item says nothing alone.
    fn axis(&self, path: &[String]) -> String {
        let names = (1..=path.len()).map(|n| path[path.len() - n..].join("_"));
        let is_word = |name: &String| name.starts_with(|first: char| first.is_alphabetic());
        let mut free = names.filter(|name| is_word(name) && !self.names.contains(name));
        free.next()
            .unwrap_or_else(|| format!("{}_{}", path.join("_"), self.names.len()))
    }

    /// Returns the overrides.
    fn overrides(&self) -> Result<Vec<Override>, CliError> {
        let mut sets = self.changes.clone();
        for (stage, axes) in &self.axes {
            let own = self.root.peek("stages").and_then(|stages| stages.peek(stage));
            if own.is_some_and(|own| own.peek("foreach").is_some()) {
                for (axis, values) in axes {
                    let set = Override::parse(&format!("stages.{stage}.foreach.{axis}=[]"))?;
                    sets.push(set.with_node(values.clone()));
                }
            } else if let Some((_, first)) = axes.first() {
                let named = |(axis, values): &(String, Node)| {
                    let name = values.with_value(NodeValue::Text(axis.clone()));
                    (name, values.clone())
                };
                let foreach = first.with_value(NodeValue::Map(axes.iter().map(named).collect()));
                let set = Override::parse(&format!("stages.{stage}.foreach={{}}"))?;
                sets.push(set.with_node(foreach));
            }
        }
        // Of another stage the run says that it does not exist.
        let is_known = self
            .arguments
            .until
            .as_deref()
            .is_none_or(|until| self.has_stage(until));
        if !self.arguments.table.is_empty() && is_known {
            sets.push(self.table_stage()?);
        }
        Ok(sets)
    }

    /// Returns the stage after which the run stops: the table needs what is collected, and the stage of `--until`.
    fn until(&self) -> Option<String> {
        match self.arguments.until.as_deref() {
            Some(until) if self.arguments.table.is_empty() || !self.has_stage(until) => Some(until.to_owned()),
            _ => (!self.arguments.table.is_empty()).then(|| self.table.clone()),
        }
    }

    /// Whether a path is that of a stage which the file does not have. Rounds may bring `NAME-2`.
    fn is_of_unknown_stage(&self, path: &[String]) -> bool {
        let [stages, name, ..] = path else { return false };
        let base = name.rsplit_once('-').map_or(name.as_str(), |(base, _)| base);
        stages == "stages" && !self.has_stage(name) && !self.has_stage(base)
    }

    fn has_stage(&self, name: &str) -> bool {
        self.stages().iter().any(|(known, _)| *known == name)
    }

    /// Returns the override that adds the stage that collects the results.
    fn table_stage(&self) -> Result<Override, CliError> {
        let last = match self.arguments.until.as_deref() {
            Some(until) => vec![until],
            None => self.last_stages(),
        };
        let mut needs: Vec<&str> = Vec::new();
        let mut results: Vec<String> = Vec::new();
        for result in self.arguments.table.iter().map(|name| name.trim()) {
            let named = result.split_once('.').filter(|(stage, _)| self.has_stage(stage));
            needs.extend(named.map_or_else(|| last.clone(), |(stage, _)| vec![stage]));
            let having: Vec<&str> = last
                .iter()
                .copied()
                .filter(|stage| self.may_have(stage, result))
                .collect();
            match having[..] {
                // Each column says of which stage it is.
                [_, _, ..] if named.is_none() => results.extend(having.iter().map(|stage| format!("{stage}.{result}"))),
                _ => results.push(result.to_owned()),
            }
        }
        needs.extend(last.iter().filter(|_| self.arguments.until.is_some()));
        let mut seen = BTreeSet::new();
        needs.retain(|stage| seen.insert(*stage));
        let mut columns: Vec<&str> = self.names.iter().map(String::as_str).collect();
        let own = self.axes_of_file(&needs);
        for column in own.iter().chain(&results) {
            if !columns.contains(&column.as_str()) {
                columns.push(column);
            }
        }
        // Messages quote the arguments, not the stage that they make.
        let word = |option: &str, word: &str| -> Result<Node, CliError> {
            let node = Override::of_option(option, &self.table, word)?.node().clone();
            Ok(node.with_value(NodeValue::Text(word.to_owned())))
        };
        let list = |words: &[&str]| -> Result<Node, CliError> {
            let items = words.iter().map(|one| word("--table", one)).collect::<Result<_, _>>()?;
            Ok(word("--table", &words.join(","))?.with_value(NodeValue::List(items)))
        };
        let mapping = |of: &Node, entries: Vec<(&str, Node)>| {
            let named = entries
                .into_iter()
                .map(|(key, node)| (node.with_value(NodeValue::Text(key.to_owned())), node));
            of.with_value(NodeValue::Map(named.collect()))
        };
        let mut stage = vec![
            ("kind", word("--table", "table")?),
            ("needs", list(&needs)?),
            ("columns", list(&columns)?),
        ];
        let plot = &self.arguments.plot;
        if !plot.is_empty() {
            if !(2..=3).contains(&plot.len()) {
                let message = format!("--plot has {} columns", plot.len());
                return Err(CliError::bad_input(message).help("expected X,Y or X,Y,SERIES"));
            }
            let axes = ["x", "y", "series"].into_iter().zip(plot);
            let axes = axes.map(|(key, column)| Ok((key, word("--plot", column)?)));
            let axes = axes.collect::<Result<_, CliError>>()?;
            stage.push(("plot", mapping(&word("--plot", &plot.join(","))?, axes)));
        }
        let set = Override::parse(&format!("stages.{}={{}}", self.table))?;
        let all = word("--table", &self.arguments.table.join(","))?;
        Ok(set.with_node(mapping(&all, stage)))
    }

    /// Returns the axes of `foreach` in the file that all of some stages have, of their own or by stages that they need.
    fn axes_of_file(&self, stages: &[&str]) -> Vec<String> {
        let of_each: Vec<Vec<String>> = stages.iter().map(|stage| self.axes_upstream(stage)).collect();
        let Some((first, others)) = of_each.split_first() else {
            return Vec::new();
        };
        let is_common = |axis: &&String| others.iter().all(|axes| axes.contains(axis));
        first.iter().filter(is_common).cloned().collect()
    }

    /// Returns the axes of a stage and of all that it needs, those of the first ones first.
    fn axes_upstream(&self, stage: &str) -> Vec<String> {
        let all = self.stages();
        let (mut open, mut seen, mut found) = (vec![stage.to_owned()], BTreeSet::new(), Vec::new());
        while let Some(name) = open.pop() {
            let Some((_, node)) = all.iter().find(|(known, _)| *known == name) else {
                continue;
            };
            if !seen.insert(name) {
                continue;
            }
            found.splice(0..0, axes_of(node));
            let needs = node.peek("needs").and_then(|needs| needs.list("needs").ok());
            let names = needs.into_iter().flatten().filter_map(|need| need.text("needs").ok());
            open.extend(names.map(str::to_owned));
        }
        let mut once = BTreeSet::new();
        found.retain(|axis| once.insert(axis.clone()));
        found
    }

    /// Returns the stages of the file, by name.
    fn stages(&self) -> Vec<(&'a str, &'a Node)> {
        let stages = self.root.peek("stages");
        let entries = stages.and_then(|stages| stages.entries("stages").ok());
        let entries = entries.unwrap_or_default().iter();
        entries
            .filter_map(|(key, node)| Some((key.text("a name").ok()?, node)))
            .collect()
    }

    /// Whether a stage of the file may have a result, by its kind.
    fn may_have(&self, name: &str, result: &str) -> bool {
        let stages = self.stages();
        let found = stages.iter().find(|(known, _)| *known == name);
        let kind = found.and_then(|(_, node)| node.peek("kind")?.text("kind").ok());
        let word = result.split('.').next().unwrap_or(result);
        kind.is_some_and(|kind| stage::result_words(kind).contains(&word))
    }

    /// Returns the stages that no other stage needs. Tables do not count: they have no results.
    fn last_stages(&self) -> Vec<&'a str> {
        let is_table = |node: &Node| node.peek("kind").is_some_and(|kind| kind.is_text("table"));
        let mut stages = self.stages();
        stages.retain(|(_, node)| !is_table(node));
        let needs = stages
            .iter()
            .flat_map(|(_, node)| ["needs", WITHOUT].map(|key| node.peek(key)?.list(key).ok()))
            .flatten();
        let needed: BTreeSet<&str> = needs.flatten().filter_map(|need| need.text("needs").ok()).collect();
        let names = stages.iter().map(|(name, _)| *name);
        names.filter(|name| !needed.contains(name)).collect()
    }
}
