//! `deaflow run`: builds what is stale, then says in a few lines what was built, what was found and where it is; in many with `-v`.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::arguments::{PROGRESS, PipelineArguments, SetArguments};
use super::cluster::{self, ClusterArguments};
use super::error::CliError;
use super::examples::examples;
use super::neglected::{self, may_break_down, neglected};
use super::output::{Exit, Output};
use super::progress::{RunProgress, Shown};
use super::run_log::RunLog;
use super::signals::Stop;
use super::text::Text;
use super::{ending, plan, table};
use deaflow_base::{ArtifactId, OutputFile, Override};
use deaflow_orchestrator::{Environment, Event, MANY_STAGES, Pipeline, RunOptions, RunOutcome, StageReport, run};
use deaflow_remote::Remote;
use deaflow_report::{FiguresAhead, Made, RunArtifacts, RunResults};
use deaflow_stage as stage;
use deaflow_store::{Command, LockFile, Store};

/// Build what is stale in a pipeline, then print what was found
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow run pipeline.yaml", "deaflow run pipeline.yaml --until solved --set stages.solved.order=1", "deaflow run pipeline.yaml -n"))]
pub struct RunArguments {
    #[command(flatten)]
    pub of: PipelineArguments,
    /// Say what would be built, as `plan` does; build nothing
    #[arg(short = 'n', long, conflicts_with_all = ["lock", "locked"])]
    pub dry_run: bool,
    /// When a stage fails, go on with all that does not need it
    #[arg(short, long)]
    pub keep_going: bool,
    /// Write the lock file beside the pipeline: the digest of everything that was built or reused
    #[arg(long, conflicts_with_all = ["until", "sets", "locked"])]
    pub lock: bool,
    /// Hold the pipeline to its lock file: any difference is an error, found before any work wherever it can be
    #[arg(long)]
    pub locked: bool,
    /// Print all that was found, and a table of the stages
    #[arg(short, long, help_heading = PROGRESS)]
    pub verbose: bool,
    /// Say nothing but warnings and errors
    #[arg(short, long, conflicts_with = "verbose", help_heading = PROGRESS)]
    pub quiet: bool,
    /// How progress is shown on stderr [default: bars on a terminal, or else plain lines]
    #[arg(long, value_enum, value_name = "HOW", conflicts_with = "quiet", help_heading = PROGRESS)]
    pub progress: Option<ProgressForm>,
    #[command(flatten)]
    pub cluster: ClusterArguments,
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

pub fn execute(arguments: &RunArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = load(&arguments.of)?;
    if arguments.dry_run {
        return plan::of_pipeline(&pipeline, &arguments.of, output);
    }
    if let Some(exit) = cluster::build(&pipeline, arguments, output)? {
        return Ok(exit);
    }
    Ok(of_pipeline(&pipeline, arguments, Command::Run, output, &|_, _| Ok(()))?.0)
}

/// What is to be done with the stages of a run.
pub type WhenBuilt<'a> = &'a dyn Fn(&Store, &[StageReport]) -> Result<(), CliError>;

/// Runs a pipeline and tells of it; also gives what each stage made. `built` is called once all is there, before anything is told.
pub fn of_pipeline(
    pipeline: &Pipeline,
    arguments: &RunArguments,
    command: Command,
    output: &Output,
    built: WhenBuilt<'_>,
) -> Result<(Exit, Vec<StageReport>), CliError> {
    let lock_path = LockFile::path_for(&pipeline.path);
    let lock = arguments.locked.then(|| read_lock(&lock_path)).transpose()?;
    if arguments.lock {
        // Before the work, not after it.
        OutputFile::at(&lock_path)?;
    }
    let reading = arguments.of.read(Store::open(&arguments.of.store_folder())?, output)?;
    let store = reading.store();
    let shown = ProgressForm::shown(arguments.progress, arguments.quiet);
    let progress = Arc::new(RunProgress::new(shown, output.beside()));
    let answers = progress.clone();
    let stop = Stop::heed(move || {
        answers.note(
            "stopping: chunks that are done, and how far trainings and searches have come, are kept; Ctrl-C again ends at once",
        );
    })?;
    let told = progress.clone();
    let watch = reading.watch(move |text| told.note(text));
    let log = RunLog::new(store, &pipeline.file(), &pipeline.overrides);
    let ahead = Ahead::default();
    let listener = |event: &_| {
        log.tell(event);
        progress.tell(event);
        ahead.tell(event, || Prepared::start(pipeline, &arguments.of, store));
    };
    let options = RunOptions {
        log: Some(&log.name),
        until: arguments.of.until.as_deref(),
        keep_going: arguments.keep_going,
        lock: lock.as_ref(),
        command,
        parallel_stages: rayon::current_num_threads(),
        stop: Some(stop.flag()),
        ..RunOptions::default()
    };
    let done = run(pipeline, store, &options, &Environment::system(), &listener);
    drop(watch);
    reading.end(output, arguments.quiet);
    let is_stopped = stop.end();
    let mut outcome = done?;
    let seconds = outcome.seconds;
    if let Some(why) = log.trouble() {
        output.complain(&format!("warning: the log file of this run is not whole: {why}"));
    }
    if !outcome.failures.is_empty() {
        let exit = failed(&mut outcome, arguments, output)?;
        return Ok((exit, outcome.stages));
    }
    // Between two stages nothing fails, and yet not all is there.
    if is_stopped && outcome.stages.len() < pipeline.selection(arguments.of.until.as_deref())?.len() {
        let exit = stopped(&outcome, arguments, output)?;
        return Ok((exit, outcome.stages));
    }
    if arguments.lock {
        store.put_lock_file(&lock_path, &outcome.lock)?;
    }
    if arguments.locked
        && let Err(error) = store.remember_lock_file(&lock_path)
    {
        output.complain(&format!("warning: `gc` will not know of the lock file: {error}"));
    }
    built(store, &outcome.stages)?;
    ahead.finish();
    if !output.is_json() && arguments.verbose {
        // Before the figures: what was built is told even where they cannot be drawn.
        output.text(table::of_run(&outcome.stages))?;
    }
    let (made, elsewhere): (Vec<Made>, Vec<Made>) = made(&outcome)
        .into_iter()
        .partition(|made| reading.remote().is_none() || is_here(store, &made.digest));
    // What nothing needed is not brought to be told of.
    let here = store.without_upstream();
    let store = &here;
    let names: Vec<&str> = made.iter().map(|made| made.stage.as_str()).collect();
    let neglected = neglected(pipeline, &names, store)?;
    let file = pipeline.file();
    let artifacts = RunArtifacts {
        store,
        file: &file,
        made: &made,
        rounds: &pipeline.rounds,
    };
    let results = RunResults::remembered(&artifacts, &pipeline.name, neglected, &may_break_down(pipeline))?;
    for text in results.warnings().cloned() {
        log.tell(&Event::Warning { text });
    }
    log.end();
    if output.is_json() {
        let mut document = document(&outcome);
        document["pipeline"] = json!(pipeline.name);
        document["store"] = json!(store.root());
        if reading.remote().is_some() {
            document["remote"] = reading.document();
            document["elsewhere"] = elsewhere.iter().map(|made| made.stage.as_str()).collect();
        }
        for (key, value) in results.document() {
            document[key] = value;
        }
        // What was said before the work comes first.
        let found = document["warnings"].as_array().into_iter().flatten().cloned();
        document["warnings"] = outcome.warnings.iter().map(|text| json!(text)).chain(found).collect();
        output.document(&document)?;
    } else if arguments.quiet {
        results.warning_lines().for_each(|line| output.complain(&line));
    } else {
        let mut text = Text::new();
        if arguments.verbose {
            for part in results.text() {
                text.line(format!("\n{part}"));
            }
            text.line("");
        } else {
            for line in results.warning_lines() {
                text.line(line);
            }
        }
        if !elsewhere.is_empty() {
            text.line(not_here(&elsewhere, reading.remote(), arguments));
        }
        ending::add_to(&mut text, &pipeline.name, &outcome, results.headlines(), seconds);
        ending::places(&mut text, &results, store, (command, arguments));
        output.text(text)?;
    }
    let exit = match outcome.unstable {
        0 => Exit::Done,
        _ => Exit::Unstable,
    };
    Ok((exit, outcome.stages))
}

/// What is told at the end, made ready while stages are at work: from the first on that is built, since where nothing is built all is there.
#[derive(Default)]
struct Ahead {
    /// Stages that were found built before that.
    reused: Mutex<Vec<Made>>,
    prepared: OnceLock<Option<Prepared>>,
}

impl Ahead {
    fn tell(&self, event: &Event, start: impl FnOnce() -> Option<Prepared>) {
        let (stage, is_new) = match event {
            Event::StageStarted { .. } => {
                self.prepared.get_or_init(|| {
                    let prepared = start()?;
                    for made in self.reused().drain(..) {
                        prepared.figures.tell(made, false);
                    }
                    Some(prepared)
                });
                return;
            }
            Event::StageFinished(stage) => (stage, true),
            Event::StageReused(stage) => (stage, false),
            _ => return,
        };
        match (self.prepared.get(), made_by(stage)) {
            (Some(Some(prepared)), Some(made)) => prepared.figures.tell(made, is_new),
            (None, Some(made)) => self.reused().push(made),
            _ => {}
        }
    }

    /// It is pushed to in one step: a panic elsewhere leaves a list that is right.
    fn reused(&self) -> MutexGuard<'_, Vec<Made>> {
        self.reused.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn finish(self) {
        if let Some(Some(prepared)) = self.prepared.into_inner() {
            prepared.figures.finish();
            // One that has panicked has said so.
            let _ = prepared.screening.join();
        }
    }
}

struct Prepared {
    figures: FiguresAhead,
    screening: JoinHandle<()>,
}

impl Prepared {
    /// None where there is to be one thread alone, or no more are to be had: then it is all done in the end.
    fn start(pipeline: &Pipeline, arguments: &PipelineArguments, store: &Store) -> Option<Self> {
        if rayon::current_num_threads() == 1 {
            return None;
        }
        let selected = pipeline.selection(arguments.until.as_deref()).ok()?;
        let stages: Vec<&str> = selected.iter().map(|at| pipeline.stages[*at].name.as_str()).collect();
        Some(Self {
            figures: FiguresAhead::start(store.without_upstream(), pipeline.file(), pipeline.name.clone()).ok()?,
            screening: neglected::ahead(pipeline, &stages, store.without_upstream()).ok()?,
        })
    }
}

impl ProgressForm {
    /// How progress is shown; without a form, as suits where stderr goes.
    pub fn shown(form: Option<Self>, quiet: bool) -> Shown {
        match form {
            _ if quiet => Shown::Warnings,
            Some(Self::None) => Shown::Warnings,
            Some(Self::Plain) => Shown::Lines,
            Some(Self::Json) => Shown::Json,
            None => Shown::Bars,
        }
    }
}

pub fn read_lock(path: &Path) -> Result<LockFile, CliError> {
    if !path.exists() {
        return Err(CliError::bad_input(format!("there is no lock file {}", path.display()))
            .help("`deaflow run --lock` writes it"));
    }
    Ok(LockFile::read(path)?)
}

/// Everything that can be wrong with the arguments is found before a store is opened.
pub fn load(arguments: &PipelineArguments) -> Result<Pipeline, CliError> {
    let pipeline = load_with(&arguments.pipeline, &arguments.set)?;
    pipeline.selection(arguments.until.as_deref())?;
    Ok(pipeline)
}

/// A pipeline with what stands on the command line for it.
pub fn load_with(path: &Path, set: &SetArguments) -> Result<Pipeline, CliError> {
    load_file(path, &set.overrides()?, set.many)
}

/// A pipeline with some changes; `many`: of more stages than a pipeline usually has.
pub fn load_file(path: &Path, overrides: &[Override], many: bool) -> Result<Pipeline, CliError> {
    let mut registry = stage::registry();
    if many {
        registry.most_stages = MANY_STAGES;
    }
    Ok(Pipeline::load(path, overrides, &registry)?)
}

/// A pipeline as it stands in its file, for a command that only looks at it.
pub fn load_plain(path: &Path) -> Result<Pipeline, CliError> {
    load_file(path, &[], true)
}

/// The store, for a command that writes nothing: where there is none yet, an empty one elsewhere stands in for it, as long
/// as its folder is held.
pub fn store_to_look_into(folder: &Path) -> Result<(Option<TempDir>, Store), CliError> {
    let scratch = (!folder.exists()).then(tempfile::tempdir).transpose();
    let scratch = scratch.map_err(|e| CliError::failure(format!("cannot make a temporary folder: {e}")))?;
    let store = Store::open(scratch.as_ref().map_or(folder, |s| s.path()))?;
    Ok((scratch, store))
}

/// Whether an artifact is here with all its chunks.
fn is_here(store: &Store, digest: &ArtifactId) -> bool {
    let here = store.without_upstream();
    here.has(digest)
        && here
            .parts(digest)
            .is_ok_and(|parts| parts.iter().all(|part| here.has(part)))
}

/// What is told of stages whose artifacts are on a remote.
fn not_here(stages: &[Made], remote: Option<&Remote>, arguments: &RunArguments) -> String {
    let names: Vec<&str> = stages.iter().map(|made| made.stage.as_str()).collect();
    let name = remote.map_or("the remote", Remote::name);
    format!(
        "on {name} and not here: {}; `deaflow pull {} --remote {name}` brings what they found",
        names.join(", "),
        arguments.of.pipeline.display()
    )
}

fn made(outcome: &RunOutcome) -> Vec<Made> {
    outcome.stages.iter().filter_map(made_by).collect()
}

fn made_by(stage: &StageReport) -> Option<Made> {
    Some(Made {
        stage: stage.name.clone(),
        kind: stage.kind.clone(),
        digest: stage.digest?,
    })
}

fn document(outcome: &RunOutcome) -> Value {
    json!({ "stages": outcome.stages, "unstable": outcome.unstable, "warnings": outcome.warnings })
}

/// What is said of a run that was stopped.
const GOES_ON: &str = "stopped: what was built is kept, and the same command goes on from there";

/// A run that was stopped before a stage was begun.
fn stopped(outcome: &RunOutcome, arguments: &RunArguments, output: &Output) -> Result<Exit, CliError> {
    let error = CliError::stopped(GOES_ON);
    if output.is_json() {
        let mut document = document(outcome);
        document["error"] = error.to_json();
        document["errors"] = json!([error.to_json()]);
        output.document(&document)?;
    } else if !arguments.quiet {
        output.text(table::of_run(&outcome.stages))?;
    }
    output.complain(GOES_ON);
    Ok(error.exit())
}

/// What was built before and beside the failures stays, and is told of.
fn failed(outcome: &mut RunOutcome, arguments: &RunArguments, output: &Output) -> Result<Exit, CliError> {
    let failures = std::mem::take(&mut outcome.failures);
    let errors = failures
        .into_iter()
        .map(|failure| CliError::from(failure.error).of_stage(&failure.stage));
    let errors: Vec<CliError> = errors.collect();
    if output.is_json() {
        let mut document = document(outcome);
        document["error"] = errors.first().map(CliError::to_json).into();
        document["errors"] = errors.iter().map(CliError::to_json).collect();
        output.document(&document)?;
    } else if !arguments.quiet {
        output.text(table::of_run(&outcome.stages))?;
    }
    // That a stage was asked to stop was said when it did, and is no error.
    let (stopped, failed): (Vec<&CliError>, Vec<&CliError>) = errors.iter().partition(|error| error.is_stop());
    failed.iter().for_each(|error| output.report(error));
    if !stopped.is_empty() {
        output.complain(GOES_ON);
    }
    // The exit code of the gravest failure would depend on taste: that of the first one it is.
    Ok(errors.first().map_or(Exit::Failure, CliError::exit))
}
