//! `deaflow status`: the contents of a store, running jobs, and stale stages.

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
use deaflow_executor::{HEARTBEAT_TIMEOUT, Seen, workers};
use deaflow_orchestrator::{Environment, Outcome, PriceTotal, StageReport, Staleness, file_of, plan};
use deaflow_store::{CheckpointProgress, Checkpoints, Command, LockFile, Run, Store, Totals};

/// Show store contents, running jobs and stale stages
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow status", "deaflow status pipeline.yaml"))]
pub struct StatusArguments {
    /// The pipelines [default: those of the last runs]
    #[arg(value_name = "PIPELINE", value_parser = pipeline_parser())]
    pub pipelines: Vec<PathBuf>,
    #[command(flatten)]
    pub store: StoreArguments,
}

/// The status of a pipeline.
struct PipelineStatus {
    path: PathBuf,
    /// The stages as in a plan, or the error of reading the pipeline.
    stages: Result<Vec<StageReport>, String>,
    /// Its last run.
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
            let path = present_path(&store, run);
            if !paths.contains(&path) {
                paths.push(path);
            }
        }
    }
    let mut pipelines = Vec::new();
    for path in paths {
        pipelines.push(status(&store, &runs, path, !arguments.pipelines.is_empty())?);
    }
    let status = StoreStatus {
        totals: store.totals()?,
        checkpoints: store.checkpoints()?,
        runs: runs.len(),
        workers: workers(&store)?,
        pipelines,
        store,
    };
    output.result(|| status.document(), || status.text())
}

/// Returns the path of the file of a run: where it is now, if the store was moved together with it.
fn present_path(store: &Store, run: &Run) -> PathBuf {
    let path = PathBuf::from(&run.path);
    let moved = file_of(&store.root().join(&run.place));
    match !run.place.is_empty() && !path.exists() && moved.is_file() {
        true => moved,
        false => path,
    }
}

/// Plans a pipeline. One of the command line must be readable; one that only a run names may be gone.
fn status(store: &Store, runs: &[Run], path: PathBuf, named: bool) -> Result<PipelineStatus, CliError> {
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
    // Relative to the current folder.
    let here = std::env::current_dir().ok();
    let near = here.and_then(|here| Some(path.strip_prefix(here).ok()?.to_owned()));
    Ok(PipelineStatus {
        locked: LockFile::path_for(&path).is_file(),
        path: near.unwrap_or(path),
        stages,
        last,
    })
}

/// The status of a store.
struct StoreStatus {
    store: Store,
    totals: Totals,
    checkpoints: Vec<Checkpoints>,
    /// Number of runs.
    runs: usize,
    workers: Vec<Seen>,
    pipelines: Vec<PipelineStatus>,
}

impl StoreStatus {
    fn document(&self) -> Value {
        let unfinished = self.checkpoints.iter().filter(|kept| kept.size > 0);
        let unfinished = unfinished.map(|kept| {
            let reached = kept.progress.clone().unwrap_or_default();
            json!({
                "key": kept.key.to_string(),
                "stage": reached.stage,
                "steps": reached.steps,
                "unit": reached.unit,
                "bytes": kept.size,
            })
        });
        let workers = self.workers.iter().map(|seen| {
            json!({
                "host": seen.worker.owner.host,
                "pid": seen.worker.owner.pid,
                "pipeline": seen.worker.pipeline,
                "array": seen.worker.array,
                "since": seen.worker.owner.since,
                "silent": seen.silent.as_secs(),
            })
        });
        let pipelines = self.pipelines.iter().map(|pipeline| {
            json!({
                "path": pipeline.path.display().to_string(),
                "last_run": pipeline.last.as_ref().map(|run| &run.created),
                "last_failed": pipeline.last.as_ref().map(|run| &run.failures),
                "last_overrides": pipeline.last.as_ref().map(|run| &run.overrides),
                "locked": pipeline.locked,
                "stages": pipeline.stages.as_ref().ok(),
                "error": pipeline.stages.as_ref().err(),
            })
        });
        json!({
            "store": self.store.root(),
            "objects": self.totals.objects,
            "bytes": self.totals.bytes,
            "records": self.totals.records,
            "runs": self.runs,
            "pins": self.totals.pins,
            "lock_files": self.totals.lock_files,
            "checkpoints": self.totals.checkpoints,
            "checkpoint_bytes": self.totals.checkpoint_bytes,
            "unfinished": unfinished.collect::<Vec<_>>(),
            "quarantined": self.totals.quarantined,
            "in_flight": self.totals.in_flight,
            "workers": workers.collect::<Vec<_>>(),
            "pipelines": pipelines.collect::<Vec<_>>(),
        })
    }

    fn text(&self) -> Text {
        let mut text = Text::from(format!(
            "{}: {} ({}), {}, {}, {}, {}",
            self.store.root().display(),
            table::counted(self.totals.objects, "artifacts"),
            table::bytes(self.totals.bytes),
            table::counted(self.totals.records, "records"),
            table::counted(self.runs as u64, "runs"),
            table::counted(self.totals.pins, "pins"),
            table::counted(self.totals.lock_files, "lock files"),
        ));
        if self.totals.quarantined > 0 {
            let folder = self.store.root().join("quarantine");
            let damaged = format!(
                "{} in {}: damaged, or with missing inputs; they are not used and can be deleted",
                table::counted(self.totals.quarantined, "files"),
                folder.display()
            );
            text.toned(Tone::Bad, damaged);
        }
        if self.totals.checkpoints > 0 {
            text.line(format!(
                "unfinished, to be continued: {} ({}){}",
                table::counted(self.totals.checkpoints, "actions"),
                table::bytes(self.totals.checkpoint_bytes),
                unfinished(&self.checkpoints)
            ));
        }
        text.line(match self.totals.in_flight {
            0 => "nothing is being built".to_owned(),
            n => format!("being built: {}", table::counted(n, "actions")),
        });
        if !self.workers.is_empty() {
            let mut rows = table::table(&["worker", "pipeline", "array", "since", "last heartbeat"], &[])
                .flowing(&["last heartbeat"])
                .dispensable(&["array", "since"]);
            for Seen { worker, silent } in &self.workers {
                let last = match *silent < HEARTBEAT_TIMEOUT {
                    true => Cell::from(format!("{} s ago", silent.as_secs())),
                    false => {
                        let silent = table::seconds(silent.as_secs_f64());
                        Cell::toned(&format!("{silent} ago: may be dead"), Tone::Caution)
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
        if !self.pipelines.is_empty() {
            let mut rows = table::table(&["pipeline", "last run", "lock", "state"], &[]).flowing(&["state"]);
            for pipeline in &self.pipelines {
                let last = pipeline
                    .last
                    .as_ref()
                    .map_or_else(|| "-".to_owned(), |run| readable_time(&run.created));
                let lock = if pipeline.locked { "yes" } else { "-" };
                let is_stale = |stage: &StageReport| stage.outcome == Outcome::Stale;
                let failed = pipeline.last.as_ref().and_then(failed);
                let tone = match &pipeline.stages {
                    _ if failed.is_some() => Tone::Bad,
                    Err(_) => Tone::Bad,
                    Ok(stages) if stages.iter().any(is_stale) => Tone::Caution,
                    Ok(_) => Tone::Dim,
                };
                rows.add_row([
                    Cell::from(pipeline.path.display()),
                    Cell::from(last),
                    Cell::from(lock),
                    Cell::toned(&(state(&pipeline.stages) + &failed.unwrap_or_default()), tone),
                ]);
            }
            text.line("").table(rows);
        }
        text
    }
}

/// The most unfinished actions that are named.
const MAX_NAMED: usize = 5;

/// Names the stages of checkpoints, and their progress.
fn unfinished(kept: &[Checkpoints]) -> String {
    let reached: Vec<&CheckpointProgress> = kept.iter().filter_map(|kept| kept.progress.as_ref()).collect();
    let named = reached
        .iter()
        .take(MAX_NAMED)
        .map(|CheckpointProgress { stage, steps, unit }| match steps {
            0 => stage.clone(),
            _ => format!("{stage} after {}", table::counted(*steps, unit)),
        });
    let named = named.collect::<Vec<_>>().join(", ");
    match reached.len() {
        0 => String::new(),
        n if n > MAX_NAMED => format!(": {named} and {} more", n - MAX_NAMED),
        _ => format!(": {named}"),
    }
}

/// Describes how the last run failed or was stopped, with its overrides; none if it did not.
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
        return format!("up to date ({})", table::counted(stages.len() as u64, "stages"));
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
