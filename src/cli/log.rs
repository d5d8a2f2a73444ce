//! `deaflow log`: lists past runs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{StoreArguments, integer, pipeline_parser};
use super::run_log::{UnfinishedRun, unfinished};
use super::snapshot::{self, ByPath, Snapshot, SnapshotReader, is_same_pipeline};
use super::table::Cell;
use super::text::Text;
use super::tone::Tone;
use super::{CliError, Exit, Output, csv, diff, locate, pipeline, sweep, table};
use deaflow_base::{Canonical, measured, readable_time};
use deaflow_orchestrator::file_of;
use deaflow_report::{RemovedArtifacts, run_document};
use deaflow_stage::{result_unit, result_words};
use deaflow_store::{Command, Run, RunStage, StageOutcome, Store, StoreError};

/// The default number of runs in the report for people.
const DEFAULT_RUNS: usize = 20;

/// The most changes of files that are listed for a run.
const MAX_CHANGES: usize = 3;

/// The most further runs that are read to find those before the listed ones: of a pipeline that has not been run for
/// long, the changes of the last listed run stay unknown.
const MAX_FURTHER: usize = 100;

/// The longest value of an added parameter that is written, in characters.
const MAX_VALUE: usize = 40;

/// Runs with more stages are not compared: each stage is a file to read.
const MAX_COMPARED: usize = 200;

/// The most results that are listed for a run.
const MAX_RESULTS: usize = 4;

/// List past runs: time, host, overrides, built stages, results
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow log", "deaflow log pipeline.yaml -n 3"))]
pub struct LogArguments {
    /// Only the runs of this pipeline, a YAML file
    #[arg(value_parser = pipeline_parser())]
    pub pipeline: Option<PathBuf>,
    /// Only the last N runs [default: 20, but all with --json and --csv]
    #[arg(short = 'n', long, value_name = "N", value_parser = integer::<u64>(1..=u64::MAX))]
    pub last: Option<u64>,
    /// Print a table as CSV: one row per run, one column per result
    #[arg(long, conflicts_with = "json")]
    pub csv: bool,
    #[command(flatten)]
    pub store: StoreArguments,
}

pub fn execute(arguments: &LogArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::existing_store(&arguments.store.folder_for(arguments.pipeline.as_deref()))?;
    let is_text = !output.is_json() && !arguments.csv;
    let most = arguments
        .last
        .map(|last| last as usize)
        .or(is_text.then_some(DEFAULT_RUNS));
    let unfinished = unfinished_of(&store, arguments.pipeline.as_deref())?;
    let Past { runs, more, before } = past(&store, arguments.pipeline.as_deref(), (most, is_text))?;
    match &arguments.pipeline {
        Some(path) if runs.is_empty() && unfinished.is_empty() => return Err(none_of(path, &store)),
        _ => {}
    }
    let removed = RemovedArtifacts::of(&store);
    if output.is_json() {
        let runs: Vec<Value> = runs.iter().map(|run| run_document(run, &removed)).collect();
        let unfinished = unfinished
            .iter()
            .map(|run| json!({ "path": run.path, "begun": run.begun, "last": run.last, "log": run.log }));
        output.document(&json!({ "runs": runs, "unfinished": unfinished.collect::<Vec<_>>() }))?;
    } else if arguments.csv {
        let names = names(&runs);
        output.plain(&csv::text(&header(&names), runs.iter().map(|run| row(run, &names)))?)?;
    } else {
        let changed = changed(&runs, &before, &store)?;
        let mut text = text(&runs, &changed, more, arguments.pipeline.is_none(), &removed);
        if !unfinished.is_empty() {
            text.line("");
        }
        for run in unfinished.iter().take(MAX_RESULTS) {
            text.toned(Tone::Caution, describe_unfinished(run, &store));
        }
        output.text(text)?;
    }
    Ok(Exit::Done)
}

/// Returns the runs that were killed or are running, of one pipeline or of all.
fn unfinished_of(store: &Store, pipeline: Option<&Path>) -> Result<Vec<UnfinishedRun>, CliError> {
    let mut found = unfinished(store)?;
    if let Some(path) = pipeline {
        let file = file_of(path);
        found.retain(|run| run.path == file);
    }
    Ok(found)
}

fn describe_unfinished(run: &UnfinishedRun, store: &Store) -> String {
    format!(
        "killed or still running: {}, started at {}; last event: {} (log: {})",
        run.path.display(),
        readable_time(&run.begun),
        run.last,
        store.root().join(&run.log).display()
    )
}

/// Runs of the past, newest first.
struct Past {
    /// The listed runs.
    runs: Vec<Run>,
    /// Whether there are more.
    more: bool,
    /// Those before the first listed runs of pipelines.
    before: Vec<Run>,
}

/// Returns the last runs, of one pipeline or of all: at most so many. Those before them are read to compare.
fn past(store: &Store, pipeline: Option<&Path>, (most, compared): (Option<usize>, bool)) -> Result<Past, CliError> {
    let all: Box<dyn Iterator<Item = Result<Run, StoreError>>> = match most {
        None => Box::new(store.runs()?.all()?.into_iter().map(Ok)),
        Some(_) => Box::new(store.runs()?),
    };
    let mut selected: Box<dyn Iterator<Item = Result<Run, StoreError>>> = match pipeline {
        None => all,
        Some(path) => Box::new(store.runs_of(all, &file_of(path), &pipeline::name_in(path))),
    };
    let listed = selected.by_ref().take(most.unwrap_or(usize::MAX));
    let runs: Vec<Run> = listed.collect::<Result<_, _>>()?;
    let (mut before, mut more): (Vec<Run>, bool) = (Vec::new(), false);
    // The rest of the history may be long.
    for run in selected.take(if compared { MAX_FURTHER } else { 1 }) {
        let run = run?;
        more = true;
        let is_same = |other: &Run| is_same_pipeline(other, &run);
        if compared && runs.iter().any(is_same) && !before.iter().any(is_same) {
            before.push(run);
        }
        if runs
            .iter()
            .all(|run| before.iter().any(|other| is_same_pipeline(other, run)))
        {
            break;
        }
    }
    Ok(Past { runs, more, before })
}

fn none_of(pipeline: &Path, store: &Store) -> CliError {
    CliError::bad_input(format!(
        "no run of {} is recorded in {}",
        pipeline.display(),
        store.root().display()
    ))
    .help("list the runs of all pipelines with `deaflow log`")
}

fn names(runs: &[Run]) -> BTreeSet<&str> {
    runs.iter()
        .flat_map(|run| run.results.keys().map(String::as_str))
        .collect()
}

fn header(results: &BTreeSet<&str>) -> Vec<String> {
    let fixed = [
        "id",
        "created",
        "pipeline",
        "path",
        "command",
        "host",
        "seconds",
        "overrides",
        "built",
        "failed",
        "stopped",
    ];
    let fixed = fixed.iter().map(|title| (*title).to_owned());
    fixed.chain(results.iter().map(|name| (*name).to_owned())).collect()
}

fn row(run: &Run, results: &BTreeSet<&str>) -> Vec<String> {
    let fixed = [
        run.id.clone(),
        run.created.clone(),
        run.pipeline.clone(),
        run.path.clone(),
        run.command.name().to_owned(),
        run.host.clone(),
        run.seconds.to_string(),
        overrides(run, "; "),
        built(run).join("; "),
        run.failures.join("; "),
        run.stopped.join("; "),
    ];
    let value = |name: &&str| {
        run.results
            .get(*name)
            .map_or_else(String::new, |value| csv::number(*value))
    };
    fixed.into_iter().chain(results.iter().map(value)).collect()
}

fn overrides(run: &Run, between: &str) -> String {
    let sets = run.overrides.iter().map(|(path, value)| format!("{path}={value}"));
    sets.collect::<Vec<_>>().join(between)
}

fn built(run: &Run) -> Vec<&str> {
    let built = run.stages.iter().filter(|stage| stage.outcome == StageOutcome::Built);
    built.map(|stage| stage.name.as_str()).collect()
}

fn text(runs: &[Run], changed: &[Vec<String>], more: bool, of_all: bool, removed: &RemovedArtifacts<'_>) -> Text {
    if runs.is_empty() {
        return Text::from("no runs");
    }
    let mut header = vec![
        "run",
        "ended",
        "pipeline",
        "took",
        "built and overrides",
        "results",
        "host",
    ];
    if !of_all {
        header.remove(2);
    }
    let mut table = table::table(&header, &["took"])
        .flowing(&["built and overrides", "results"])
        .dispensable(&["host"])
        .at_most(WIDTH);
    for (at, run) in runs.iter().enumerate() {
        let tone = match (run.failures.is_empty(), run.stopped.is_empty()) {
            (true, true) => Tone::Plain,
            (true, false) => Tone::Caution,
            (false, _) => Tone::Bad,
        };
        let mut cells: Vec<Cell> = vec![
            format!("@{} {}", at + 1, run.id).into(),
            readable_time(&run.created).into(),
            match run.command {
                Command::Run => Cell::from(&run.pipeline),
                Command::Audit => format!("{}\n(audit)", run.pipeline).into(),
                Command::Sweep => format!("{}\n(sweep)", run.pipeline).into(),
            },
            table::seconds(run.seconds).into(),
            Cell::toned(&describe(run, &changed[at], removed), tone),
            results(run).into(),
            Cell::from(&run.host),
        ];
        if !of_all {
            cells.remove(2);
        }
        table.add_row(cells);
    }
    let mut text = Text::of(table);
    if more {
        text.line("\nolder runs: -n N lists the last N, --json and --csv list all");
    }
    text
}

/// The width of tables with long values where there is no terminal.
pub const WIDTH: usize = 120;

/// Describes how the files of each run differ from those of the run before it, of the same pipeline, in the stages that
/// both have; `before` are runs that are not listed. What an override may have changed is left out, and so is the stage
/// that a sweep adds.
fn changed(listed: &[Run], before: &[Run], store: &Store) -> Result<Vec<Vec<String>>, CliError> {
    let reader = SnapshotReader::new(store);
    let runs: Vec<&Run> = listed.iter().chain(before).collect();
    let snapshots: Vec<Snapshot> = runs
        .iter()
        .map(|run| match run.stages.len() {
            0..=MAX_COMPARED => reader.parameters_of_run(run),
            _ => Ok(Snapshot::new(run.id.clone())),
        })
        .collect::<Result<_, _>>()?;
    let of = |at: usize| {
        let is_same = |other: &usize| is_same_pipeline(runs[*other], runs[at]);
        let Some(before) = (at + 1..runs.len()).find(is_same) else {
            return Vec::new();
        };
        let runs = [runs[before], runs[at]];
        let snapshots = [&snapshots[before], &snapshots[at]];
        changes_of_files(runs, snapshots)
            .into_iter()
            .chain(unknown_changes(runs, snapshots))
            .collect()
    };
    Ok((0..listed.len()).map(of).collect())
}

/// Describes the parameters of files that differ between two runs: first those with two values, then those that were
/// added or removed.
fn changes_of_files(runs: [&Run; 2], [from, to]: [&Snapshot; 2]) -> Vec<String> {
    let differing = |path: &&String| runs[0].overrides.get(*path) != runs[1].overrides.get(*path);
    let sets: BTreeSet<&String> = runs.iter().flat_map(|run| run.overrides.keys()).collect();
    let sets: Vec<&String> = sets.into_iter().filter(differing).collect();
    let added: Vec<String> = runs
        .iter()
        .filter(|run| run.command == Command::Sweep)
        .flat_map(|run| run.stages.iter().filter(|stage| sweep::is_added(stage)))
        .map(|stage| format!("stages.{}.", stage.name))
        .collect();
    let shared = [from.shared_with(to), to.shared_with(from)];
    let shared = shared.each_ref();
    let values = snapshot::written_parameters(shared);
    let mut changes = diff::changes(shared, &values);
    changes.retain(|change| {
        let is_set = sets.iter().any(|path| may_change(path, &change.name));
        !is_set && !added.iter().any(|start| change.name.starts_with(start))
    });
    let (both, one): (Vec<_>, Vec<_>) = changes
        .into_iter()
        .partition(|change| change.from.is_some() && change.to.is_some());
    let text = |value: &Option<Canonical>| value.as_ref().map_or_else(String::new, Canonical::to_string);
    let mut described: Vec<String> = diff::together(&both)
        .into_iter()
        .map(|(name, change)| format!("{name} from {} to {}", text(&change.from), text(&change.to)))
        .collect();
    described.extend(added_or_removed(&one, &values));
    described
}

/// Describes parameters that only one side has. Those of a mapping that the other side lacks are named by it.
fn added_or_removed(changes: &[diff::Change<Canonical>], [before, after]: &[ByPath; 2]) -> Vec<String> {
    let part = |change: &diff::Change<Canonical>| {
        let (others, word) = match change.from {
            Some(_) => (after, "removed"),
            None => (before, "added"),
        };
        (missing_part(&change.name, others).to_owned(), word)
    };
    let mut parts: BTreeMap<(String, &str), Vec<&diff::Change<Canonical>>> = BTreeMap::new();
    for change in changes {
        parts.entry(part(change)).or_default().push(change);
    }
    let described = parts.into_iter().map(|((part, word), changes)| {
        let [change] = changes[..] else {
            return format!("{part} {word}");
        };
        let value = change.to.as_ref().map(Canonical::to_string);
        match value.filter(|value| value.chars().count() <= MAX_VALUE) {
            Some(value) => format!("{} {word} ({value})", change.name),
            None => format!("{} {word}", change.name),
        }
    });
    described.collect()
}

/// Returns the shortest start of a path, up to a dot or its end, that is no start of other paths.
fn missing_part<'p>(path: &'p str, others: &ByPath) -> &'p str {
    let is_known = |start: &str| {
        let within = format!("{start}.");
        let next = others.range(within.clone()..).next();
        others.contains_key(start) || next.is_some_and(|(other, _)| other.starts_with(&within))
    };
    let ends = path.match_indices('.').map(|(at, _)| at);
    let mut starts = ends.map(|end| &path[..end]).filter(|start| !is_known(start));
    starts.next().unwrap_or(path)
}

/// Whether an override may change a parameter: any of its stage, since parameters follow from others, or of its section
/// of the scene.
fn may_change(path: &str, parameter: &str) -> bool {
    let is_at = |name: &str, start: &str| {
        let rest = name.strip_prefix(start);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '@']))
    };
    match path.split('.').collect::<Vec<_>>().as_slice() {
        ["stages", stage, ..] => is_at(parameter, &format!("stages.{stage}")),
        ["scene", rest @ ..] => {
            let section = rest
                .first()
                .map_or("scene".to_owned(), |section| format!("scene.{section}"));
            // Where stages have different values, each has its own.
            let of_stage = parameter.strip_prefix("stages.").and_then(|rest| rest.find(".scene."));
            let own = of_stage.map(|at| &parameter["stages.".len() + at + 1..]);
            is_at(parameter, &section) || own.is_some_and(|own| is_at(own, &section))
        }
        _ => false,
    }
}

/// Names the stages of two runs that differ in parameters which are not recorded any more; none if overrides explain
/// it.
fn unknown_changes(runs: [&Run; 2], snapshots: [&Snapshot; 2]) -> Option<String> {
    let differs = |name: &&str| {
        let keys = runs.map(|run| run.stage(name).map(|stage| stage.key));
        let sets = runs.into_iter().flat_map(|run| run.overrides.keys());
        let is_set = |path: &String| path.starts_with("scene") || path.starts_with(&format!("stages.{name}."));
        keys.iter().all(Option::is_some) && keys[0] != keys[1] && !sets.into_iter().any(is_set)
    };
    let mut names: Vec<&str> = snapshots.into_iter().flat_map(Snapshot::without_parameters).collect();
    names.sort_unstable();
    names.dedup();
    names.retain(differs);
    (!names.is_empty()).then(|| format!("unknown changes of {}", names.join(", ")))
}

/// Describes what was built, what failed, what was overridden, and what has been removed since.
fn describe(run: &Run, changed: &[String], removed: &RemovedArtifacts<'_>) -> String {
    let built = built(run);
    let all = run.stages.len() + run.failures.len() + run.stopped.len() + run.not_begun.len();
    let mut lines = vec![match built.len() {
        0 => format!("none of {all}"),
        n if n > MAX_RESULTS => format!("{n} of {all}"),
        n => format!("{n} of {all}: {}", built.join(", ")),
    }];
    lines.extend(run.failures.iter().map(|name| format!("failed: {name}")));
    lines.extend(run.stopped.iter().map(|name| format!("stopped: {name}")));
    lines.extend((!run.not_begun.is_empty()).then(|| format!("{} not started", run.not_begun.len())));
    if !run.overrides.is_empty() {
        lines.push(overrides(run, "\n"));
    }
    if !changed.is_empty() {
        let more = changed.len().saturating_sub(MAX_CHANGES);
        lines.push(format!(
            "changed in the files: {}",
            changed[..changed.len() - more].join(", ")
        ));
        lines.extend((more > 0).then(|| format!("and {more} more: deaflow diff")));
    }
    let gone: Vec<&str> = run
        .stages
        .iter()
        .filter_map(|stage| removed.at(&stage.artifact))
        .collect();
    if let Some(last) = gone.iter().max() {
        lines.push(format!(
            "{} of {all} removed by gc at {}",
            gone.len(),
            readable_time(last)
        ));
    }
    lines.join("\n")
}

/// Writes a result of a stage with its unit; shares in per cent.
pub fn with_unit(name: &str, value: f64) -> String {
    let is_share = matches!(name.split('.').next(), Some("area" | "yield" | "failed"));
    match result_unit(name) {
        "1" if is_share => format!("{} %", table::number(100.0 * value)),
        _ => in_unit_of(name, table::number(value)),
    }
}

/// Writes a result of a stage with its estimated error and its unit.
pub fn with_error(name: &str, value: f64, error: f64) -> String {
    in_unit_of(name, measured(value, error))
}

/// Adds the unit of a result to its number.
fn in_unit_of(name: &str, number: String) -> String {
    match result_unit(name) {
        "1" => number,
        unit => format!("{number} {unit}"),
    }
}

/// Lists the results of the last stages of a run.
fn results(run: &Run) -> String {
    let of = |stage: &RunStage| {
        let prefix = format!("{}.", stage.name);
        let all = run.results.range(prefix.clone()..);
        let own = all.take_while(|(name, _)| name.starts_with(&prefix));
        let mut own: Vec<(&str, f64)> = own.map(|(name, value)| (&name[prefix.len()..], *value)).collect();
        // Displacements and forces before counts and shares, then in the order of their importance.
        let words = result_words(&stage.kind);
        let rank = |name: &str| words.iter().position(|word| name.split('.').next() == Some(word));
        own.sort_by_key(|(name, _)| (result_unit(name) == "1", rank(name).unwrap_or(words.len())));
        let line = |(name, value): (&str, f64)| format!("{prefix}{name} {}", with_unit(name, value));
        own.into_iter().map(line).collect::<Vec<_>>()
    };
    let mut lines: Vec<String> = run.stages.iter().rev().flat_map(of).collect();
    if lines.len() > MAX_RESULTS {
        let more = lines.len() - MAX_RESULTS;
        lines.truncate(MAX_RESULTS);
        lines.push(format!("and {more} more"));
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_of_a_part_that_the_other_side_lacks_are_named_by_it() {
        let values = |paths: &[&str]| -> ByPath {
            let each = paths.iter().map(|path| ((*path).to_owned(), Canonical::from(3_u64)));
            each.collect()
        };
        let before = values(&["scene.effects.gravity", "scene.tolerances.mask", "stages.a@r=1.5.kind"]);
        let after = values(&[
            "scene.effects.creep.branches",
            "scene.effects.creep.time",
            "scene.effects.gravity",
            "scene.tolerances.thickness",
            "stages.a@r=1.5.kind",
            "stages.a@r=1.5.order",
        ]);
        let only = |one: &ByPath, other: &ByPath| -> Vec<(String, Canonical)> {
            let missing = one.iter().filter(|(path, _)| !other.contains_key(*path));
            missing.map(|(path, value)| (path.clone(), value.clone())).collect()
        };
        let change = |name, [from, to]: [Option<Canonical>; 2]| diff::Change {
            name,
            from,
            to,
            errors: [None; 2],
        };
        let removed = only(&before, &after).into_iter();
        let removed = removed.map(|(path, value)| change(path, [Some(value), None]));
        let added = only(&after, &before).into_iter();
        let changes: Vec<_> = removed
            .chain(added.map(|(path, value)| change(path, [None, Some(value)])))
            .collect();
        assert_eq!(
            added_or_removed(&changes, &[before, after]),
            [
                "scene.effects.creep added",
                "scene.tolerances.mask removed",
                "scene.tolerances.thickness added (3)",
                "stages.a@r=1.5.order added (3)",
            ]
        );
    }

    #[test]
    fn an_override_may_change_its_stage_or_its_section_of_the_scene() {
        for (path, parameter, expected) in [
            ("stages.verified.elements_per_cell", "stages.verified.order", true),
            ("stages.solved.foreach", "stages.solved@voltage=9kV.order", true),
            ("stages.solve.order", "stages.solved.order", false),
            ("scene.drive.voltage", "scene.drive.voltages", true),
            ("scene.drive.voltage", "stages.solved.scene.drive.voltage", true),
            ("scene.drive.voltage", "scene.material.shear_modulus", false),
            ("scene.drive.voltage", "stages.solved.order", false),
            ("scene", "scene.material.shear_modulus", true),
            ("scene", "stages.solved.scene.material.shear_modulus", true),
        ] {
            assert_eq!(may_change(path, parameter), expected, "{path} {parameter}");
        }
    }
}
