//! `deaflow status`: what is in a store, what is at work in it, and what of pipelines would be built.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{StoreArguments, pipeline_parser};
use super::snapshot::sets_of;
use super::table::Cell;
use super::text::Text;
use super::tone::Tone;
use super::{CliError, Exit, Output, locate, pipeline, table};
use deaflow_base::readable_time;
use deaflow_executor::{SILENT, Seen, workers};
use deaflow_orchestrator::{Environment, Outcome, PriceTotal, StageReport, Staleness, file_of, plan};
use deaflow_store::{CheckpointProgress, Checkpoints, Command, LockFile, Run, Store, Totals};

/// Say what is in a store, what is at work in it, and what of pipelines would be built
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow status", "deaflow status pipeline.yaml"))]
pub struct StatusArguments {
    /// Pipelines to look at [default: those of the last runs]
    #[arg(value_name = "PIPELINE", value_parser = pipeline_parser())]
    pub pipelines: Vec<PathBuf>,
    #[command(flatten)]
    pub store: StoreArguments,
}

/// How a pipeline stands.
struct Standing {
    path: PathBuf,
    /// The stages as in a plan, or why the pipeline cannot be read.
    stages: Result<Vec<StageReport>, String>,
    /// The run that it was last part of.
    last: Option<Run>,
    locked: bool,
}

pub fn execute(arguments: &StatusArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::existing_store(
        &arguments
            .store
            .folder_for(arguments.pipelines.first().map(PathBuf::as_path)),
    )?;
    let runs = store.runs()?.all()?;
    let mut paths: Vec<PathBuf> = arguments.pipelines.iter().map(|path| file_of(path)).collect();
    if paths.is_empty() {
        for run in &runs {
            let path = PathBuf::from(&run.path);
            if !paths.contains(&path) {
                paths.push(path);
            }
        }
    }
    let mut standings = Vec::new();
    for path in paths {
        standings.push(standing(&store, &runs, path, !arguments.pipelines.is_empty())?);
    }
    let totals = store.totals()?;
    let kept = store.checkpoints()?;
    let workers = workers(&store)?;
    if output.is_json() {
        output.document(&document(&store, &totals, &kept, runs.len(), &workers, &standings))?;
    } else {
        output.text(text(&store, &totals, &kept, runs.len(), &workers, &standings))?;
    }
    Ok(Exit::Done)
}

/// A pipeline that somebody names must be there; one that only a run remembers may be gone.
fn standing(store: &Store, runs: &[Run], path: PathBuf, named: bool) -> Result<Standing, CliError> {
    let last = |name: Option<&str>| {
        let all = runs.iter().filter(|run| run.command == Command::Run).cloned().map(Ok);
        let mut own = store.runs_of(all, &path, name.unwrap_or_default());
        own.next().and_then(Result::ok)
    };
    let (stages, last) = match pipeline::load_plain(&path) {
        Ok(pipeline) => {
            let stages = plan(&pipeline, store, None, &Environment::system())?;
            (Ok(stages), last(Some(&pipeline.name)))
        }
        Err(error) if named => return Err(error),
        Err(error) => (Err(error.message().to_owned()), last(None)),
    };
    // As it would be named here.
    let here = std::env::current_dir().ok();
    let near = here.and_then(|here| Some(path.strip_prefix(here).ok()?.to_owned()));
    Ok(Standing {
        locked: LockFile::path_for(&path).is_file(),
        path: near.unwrap_or(path),
        stages,
        last,
    })
}

fn document(
    store: &Store,
    totals: &Totals,
    kept: &[Checkpoints],
    runs: usize,
    workers: &[Seen],
    standings: &[Standing],
) -> Value {
    let unfinished = kept.iter().filter(|kept| kept.size > 0);
    let unfinished = unfinished.map(|kept| {
        let reached = kept.progress.clone().unwrap_or_default();
        json!({ "key": kept.key.to_string(), "stage": reached.stage, "steps": reached.steps, "unit": reached.unit, "bytes": kept.size })
    });
    let workers = workers.iter().map(|seen| {
        json!({
            "host": seen.worker.owner.host,
            "pid": seen.worker.owner.pid,
            "pipeline": seen.worker.pipeline,
            "array": seen.worker.array,
            "since": seen.worker.owner.since,
            "silent": seen.silent.as_secs(),
        })
    });
    let pipelines = standings.iter().map(|standing| {
        json!({
            "path": standing.path.display().to_string(),
            "last_run": standing.last.as_ref().map(|run| &run.created),
            "last_failed": standing.last.as_ref().map(|run| &run.failures),
            "last_overrides": standing.last.as_ref().map(|run| &run.overrides),
            "locked": standing.locked,
            "stages": standing.stages.as_ref().ok(),
            "error": standing.stages.as_ref().err(),
        })
    });
    json!({
        "store": store.root(),
        "objects": totals.objects,
        "bytes": totals.bytes,
        "records": totals.records,
        "runs": runs,
        "pins": totals.pins,
        "lock_files": totals.lock_files,
        "checkpoints": totals.checkpoints,
        "checkpoint_bytes": totals.checkpoint_bytes,
        "unfinished": unfinished.collect::<Vec<_>>(),
        "quarantined": totals.quarantined,
        "in_flight": totals.in_flight,
        "workers": workers.collect::<Vec<_>>(),
        "pipelines": pipelines.collect::<Vec<_>>(),
    })
}

/// Unfinished actions that are named.
const NAMED: usize = 5;

/// Which stages what is kept is of, and how far each has come.
fn unfinished(kept: &[Checkpoints]) -> String {
    let reached: Vec<&CheckpointProgress> = kept.iter().filter_map(|kept| kept.progress.as_ref()).collect();
    let named = reached
        .iter()
        .take(NAMED)
        .map(|CheckpointProgress { stage, steps, unit }| match steps {
            0 => stage.clone(),
            _ => format!("{stage} after {}", table::counted(*steps, unit)),
        });
    let named = named.collect::<Vec<_>>().join(", ");
    match reached.len() {
        0 => String::new(),
        n if n > NAMED => format!(": {named} and {} more", n - NAMED),
        _ => format!(": {named}"),
    }
}

fn text(
    store: &Store,
    totals: &Totals,
    kept: &[Checkpoints],
    runs: usize,
    workers: &[Seen],
    standings: &[Standing],
) -> Text {
    let mut text = Text::from(format!(
        "{}: {} ({}), {}, {}, {}, {}",
        store.root().display(),
        table::counted(totals.objects, "artifacts"),
        table::bytes(totals.bytes),
        table::counted(totals.records, "records"),
        table::counted(runs as u64, "runs"),
        table::counted(totals.pins, "pins"),
        table::counted(totals.lock_files, "lock files"),
    ));
    if totals.quarantined > 0 {
        let folder = store.root().join("quarantine");
        let damaged = format!(
            "{} lie in {}, set aside as damaged or for want of what they name; nothing reads them, and they may be deleted",
            table::counted(totals.quarantined, "files"),
            folder.display()
        );
        text.toned(Tone::Bad, damaged);
    }
    if totals.checkpoints > 0 {
        text.line(format!(
            "unfinished and to be gone on with: {} ({}){}",
            table::counted(totals.checkpoints, "actions"),
            table::bytes(totals.checkpoint_bytes),
            unfinished(kept)
        ));
    }
    text.line(match totals.in_flight {
        0 => "nothing is being built".to_owned(),
        1 => "one action is being built".to_owned(),
        n => format!("{n} actions are being built"),
    });
    if !workers.is_empty() {
        let mut rows = table::table(&["worker", "pipeline", "array", "since", "last sign of life"], &[])
            .flowing(&["last sign of life"])
            .dispensable(&["array", "since"]);
        for Seen { worker, silent } in workers {
            let last = match *silent < SILENT {
                true => Cell::from(format!("{} s ago", silent.as_secs())),
                false => {
                    let silent = table::seconds(silent.as_secs_f64());
                    Cell::toned(&format!("{silent} ago: perhaps dead"), Tone::Caution)
                }
            };
            rows.add_row([
                Cell::from(format!("{} on {}", worker.owner.pid, worker.owner.host)),
                Cell::from(&worker.pipeline),
                Cell::from(worker.array.as_deref().unwrap_or("-")),
                Cell::from(&worker.owner.since),
                last,
            ]);
        }
        text.line("").table(rows);
    }
    if !standings.is_empty() {
        let mut rows = table::table(&["pipeline", "last run", "lock", "state"], &[]).flowing(&["state"]);
        for standing in standings {
            let last = standing
                .last
                .as_ref()
                .map_or_else(|| "-".to_owned(), |run| readable_time(&run.created));
            let lock = if standing.locked { "yes" } else { "-" };
            let is_stale = |stage: &StageReport| stage.outcome == Outcome::Stale;
            let failed = standing.last.as_ref().and_then(failed);
            let tone = match &standing.stages {
                _ if failed.is_some() => Tone::Bad,
                Err(_) => Tone::Bad,
                Ok(stages) if stages.iter().any(is_stale) => Tone::Caution,
                Ok(_) => Tone::Dim,
            };
            rows.add_row([
                Cell::from(standing.path.display()),
                Cell::from(last),
                Cell::from(lock),
                Cell::toned(&(state(&standing.stages) + &failed.unwrap_or_default()), tone),
            ]);
        }
        text.line("").table(rows);
    }
    text
}

/// How the last run failed, or was stopped, and by which values, as a line; none where it did not.
fn failed(run: &Run) -> Option<String> {
    let what = match (run.failures.as_slice(), run.stopped.as_slice()) {
        ([], []) => return None,
        ([], stopped) => format!("was stopped in {}", stopped.join(", ")),
        (failures, _) => format!("failed: {}", failures.join(", ")),
    };
    let with = match run.overrides.is_empty() {
        true => String::new(),
        false => format!(", with{},", sets_of(&run.overrides)),
    };
    Some(format!("\nthe last run{with} {what}"))
}

fn state(stages: &Result<Vec<StageReport>, String>) -> String {
    let stages = match stages {
        Ok(stages) => stages,
        Err(reason) => return format!("cannot be read: {reason}"),
    };
    let stale: Vec<&StageReport> = stages.iter().filter(|s| s.outcome == Outcome::Stale).collect();
    if stale.is_empty() {
        return format!(
            "nothing to build: {} reused",
            table::counted(stages.len() as u64, "stages")
        );
    }
    let named = |stage: &&StageReport| match &stage.staleness {
        Some(why @ (Staleness::ArtifactDamaged | Staleness::ArtifactMissing)) => format!("{}: {why}", stage.name),
        _ => stage.name.clone(),
    };
    let names: Vec<String> = stale.iter().map(named).collect();
    let total = PriceTotal::of(stale.iter().map(|stage| stage.price));
    format!(
        "{} of {} stages to build ({}): {}",
        total.stale,
        stages.len(),
        names.join(", "),
        table::price(total.price.as_ref(), total.unpriced)
    )
}
