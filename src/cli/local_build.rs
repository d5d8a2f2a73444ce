//! Builds a pipeline in this process and reports the results: the part that `run`, `attach` and `sweep` share.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use serde_json::{Value, json};

use super::arguments::{PipelineArguments, VerbosityArguments};
use super::neglected::{neglected_effects, observing};
use super::pipeline::read_lock;
use super::progress::RunProgress;
use super::run_log::RunLog;
use super::signals::Stop;
use super::text::Text;
use super::upstream::{self, StoreAccess};
use super::{CliError, Exit, Output, summary, table};
use deaflow_base::{ArtifactId, OutputFile};
use deaflow_orchestrator::{Environment, Event, Pipeline, RunOptions, RunOutcome, StageReport, run};
use deaflow_remote::Remote;
use deaflow_report::{BackgroundFigures, RunArtifacts, RunResults, StageArtifact};
use deaflow_store::{Command, LockFile, Store};

/// A pipeline to build, and how.
pub struct Build<'a> {
    pub pipeline: &'a Pipeline,
    pub of: &'a PipelineArguments,
    /// The command, for the history of runs.
    pub command: Command,
    pub keep_going: bool,
    pub lock: LockMode,
    pub verbosity: VerbosityArguments,
}

/// What to do with the lock file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LockMode {
    Ignore,
    /// Write it after the build.
    Write,
    /// Fail on any difference from it.
    Check,
}

/// How a build ended.
pub enum BuildResult<'a> {
    /// A stage failed, or the build was stopped; this has been reported.
    Incomplete(Exit),
    /// Everything is built, and not yet reported.
    Complete(Box<CompleteBuild<'a>>),
}

/// A build that succeeded.
pub struct CompleteBuild<'a> {
    build: &'a Build<'a>,
    access: StoreAccess,
    log: RunLog,
    outcome: RunOutcome,
    preparation: Preparation,
}

/// The message after a stop.
const STOPPED: &str = "stopped: finished work is kept; the same command continues";

impl Build<'_> {
    /// Builds the pipeline and reports the results.
    ///
    /// # Errors
    /// When the build cannot start, or a result cannot be read or printed.
    pub fn execute(&self, output: &Output) -> Result<Exit, CliError> {
        match self.run(output)? {
            BuildResult::Incomplete(exit) => Ok(exit),
            BuildResult::Complete(complete) => complete.report(output),
        }
    }

    /// Builds the pipeline; reports failures, but not yet results.
    ///
    /// # Errors
    /// When the build cannot start.
    pub fn run(&self, output: &Output) -> Result<BuildResult<'_>, CliError> {
        let lock_path = LockFile::path_for(&self.pipeline.path);
        let lock = match self.lock {
            LockMode::Check => Some(read_lock(&lock_path)?),
            LockMode::Ignore => None,
            LockMode::Write => {
                // A path that cannot be written is an error before the work.
                OutputFile::new(&lock_path)?;
                None
            }
        };
        let access = StoreAccess::open(Store::open(&self.of.store_folder())?, self.of, output)?;
        let log = RunLog::new(access.store(), &self.pipeline.file(), &self.pipeline.overrides);
        let preparation = Preparation::default();
        let (outcome, is_stopped) = self.run_stages(&access, lock.as_ref(), &log, &preparation, output)?;
        if let Some(why) = log.failure() {
            output.warn(format_args!("the log file of this run is incomplete: {why}"));
        }
        if !outcome.failures.is_empty() {
            return Ok(BuildResult::Incomplete(self.report_failures(outcome, output)?));
        }
        // Stopped between two stages: no stage has failed, but some are missing.
        if is_stopped && outcome.stages.len() < self.pipeline.selection(self.of.until.as_deref())?.len() {
            let error = CliError::stopped(STOPPED);
            self.report_errors(&outcome, std::slice::from_ref(&error), output)?;
            output.note(STOPPED);
            return Ok(BuildResult::Incomplete(error.exit()));
        }
        if self.lock == LockMode::Write {
            outcome.lock.write(&lock_path)?;
        }
        if self.lock != LockMode::Ignore
            && let Err(error) = access.store().remember_lock_file(&lock_path)
        {
            output.warn(format_args!("`gc` will not respect the lock file: {error}"));
        }
        Ok(BuildResult::Complete(Box::new(CompleteBuild {
            build: self,
            access,
            log,
            outcome,
            preparation,
        })))
    }

    /// Runs the stages; returns the outcome, and whether a signal asked to stop.
    fn run_stages(
        &self,
        access: &StoreAccess,
        lock: Option<&LockFile>,
        log: &RunLog,
        preparation: &Preparation,
        output: &Output,
    ) -> Result<(RunOutcome, bool), CliError> {
        let mode = self.verbosity.progress.mode();
        let progress = Arc::new(RunProgress::new(mode, output.errors()));
        let answer = progress.clone();
        let stop = Stop::on_signals(move || {
            answer.note("stopping: finished chunks and checkpoints are kept; press Ctrl-C again to end at once");
        })?;
        let transfers = progress.clone();
        let watch = access.watch(move |text| transfers.note(text));
        let listener = |event: &_| {
            log.write(event);
            progress.show(event);
            preparation.update(event, || figures_of(self.pipeline, access.store()));
        };
        let options = RunOptions {
            log: Some(&log.name),
            until: self.of.until.as_deref(),
            keep_going: self.keep_going,
            lock,
            command: self.command,
            parallel_stages: rayon::current_num_threads(),
            stop: Some(stop.flag()),
            ..RunOptions::default()
        };
        let environment = Environment::system();
        let done = run(self.pipeline, access.store(), &options, &environment, &listener);
        drop(watch);
        access.end(output, self.verbosity.progress.quiet);
        let is_stopped = stop.end();
        Ok((done?, is_stopped))
    }

    /// Reports what was built in spite of the failures, and the failures.
    fn report_failures(&self, mut outcome: RunOutcome, output: &Output) -> Result<Exit, CliError> {
        let failures = std::mem::take(&mut outcome.failures).into_iter();
        let errors: Vec<CliError> = failures
            .map(|failure| CliError::from(failure.error).of_stage(&failure.stage))
            .collect();
        self.report_errors(&outcome, &errors, output)?;
        // A stop is not an error.
        let (stopped, failed): (Vec<&CliError>, Vec<&CliError>) = errors.iter().partition(|error| error.is_stop());
        failed.iter().for_each(|error| output.report(error));
        if !stopped.is_empty() {
            output.note(STOPPED);
        }
        // Which failure is the gravest is debatable: the first one decides.
        Ok(errors.first().map_or(Exit::Failure, CliError::exit))
    }

    /// Prints the stages and, for programs, the errors.
    fn report_errors(&self, outcome: &RunOutcome, errors: &[CliError], output: &Output) -> Result<(), CliError> {
        if output.is_json() {
            let mut document = document(outcome);
            document["error"] = errors.first().map(CliError::to_json).into();
            document["errors"] = errors.iter().map(CliError::to_json).collect();
            output.document(&document)
        } else if self.verbosity.progress.quiet {
            Ok(())
        } else {
            output.text(table::of_run(&outcome.stages))
        }
    }
}

impl CompleteBuild<'_> {
    /// The store that was built in.
    pub fn store(&self) -> &Store {
        self.access.store()
    }

    /// The stages.
    pub fn stages(&self) -> &[StageReport] {
        &self.outcome.stages
    }

    /// Draws the figures and reports the results.
    ///
    /// # Errors
    /// When a result cannot be read, a figure cannot be written, or the report cannot be printed.
    pub fn report(self, output: &Output) -> Result<Exit, CliError> {
        let Self {
            build,
            access,
            log,
            outcome,
            preparation,
        } = self;
        let pipeline = build.pipeline;
        preparation.finish();
        if !output.is_json() && build.verbosity.verbose {
            // Printed before the figures are drawn, which may fail.
            output.text(table::of_run(&outcome.stages))?;
        }
        let made = outcome.stages.iter().filter_map(made_by);
        let (made, elsewhere): (Vec<StageArtifact>, Vec<StageArtifact>) =
            made.partition(|made| access.remote().is_none() || is_here(access.store(), &made.digest));
        let doubt = access.doubt(&elsewhere)?;
        access
            .remote()
            .into_iter()
            .for_each(|remote| upstream::report_problems(remote, output));
        // Artifacts that no stage needed are not fetched for the report.
        let store = &access.store().without_upstream();
        let artifacts = RunArtifacts {
            store,
            file: &pipeline.file(),
            stages: &made,
            rounds: &pipeline.rounds,
        };
        let neglected = neglected_effects(pipeline, &artifacts, build.verbosity.progress.mode())?;
        let results = RunResults::cached(&artifacts, &pipeline.name, neglected.all(), &observing(pipeline))?;
        for text in results.warnings().cloned() {
            log.write(&Event::Warning { text });
        }
        log.end();
        if output.is_json() {
            let mut document = results_document(&outcome, &results);
            document["pipeline"] = json!(pipeline.name);
            document["store"] = json!(store.root());
            if access.remote().is_some() {
                document["remote"] = access.document();
                document["elsewhere"] = elsewhere.iter().map(|made| made.stage.as_str()).collect();
            }
            output.document(&document)?;
        } else if build.verbosity.progress.quiet {
            results.warning_lines().for_each(|line| output.note(&line));
        } else {
            let mut text = build.results_text(&outcome, &results, &neglected.of_samples);
            let pull = build.pull(&elsewhere, access.remote());
            if let Some(remote) = access.remote().filter(|_| pull.is_some()) {
                let names: Vec<&str> = elsewhere.iter().map(|made| made.stage.as_str()).collect();
                text.line(format!("on {} only: {}", remote.name(), names.join(", ")));
            }
            build.add_next(&mut text, &results, access.store().root(), pull);
            output.text(text)?;
        }
        if let Some((why, exit)) = doubt {
            output.warn(why);
            return Ok(exit);
        }
        Ok(match outcome.unstable {
            0 => Exit::Done,
            _ => Exit::Unstable,
        })
    }
}

impl Build<'_> {
    /// Returns the results, then their warnings. Without details, those in `of_samples` are only counted.
    fn results_text(&self, outcome: &RunOutcome, results: &RunResults, of_samples: &[String]) -> Text {
        let mut text = Text::new();
        if self.verbosity.verbose {
            for part in results.text() {
                text.line(format!("\n{part}"));
            }
            text.line("");
        }
        summary::add_results(&mut text, &self.pipeline.name, outcome, results.headlines());
        if !self.verbosity.verbose {
            summary::add_warnings(&mut text, results, of_samples);
        }
        text
    }

    /// Adds where figures and artifacts are, and what may follow.
    fn add_next(&self, text: &mut Text, results: &RunResults, store: &Path, pull: Option<String>) {
        summary::add_places(text, results, store, self.verbosity.verbose);
        let lock = LockFile::path_for(&self.pipeline.path);
        match self.lock {
            LockMode::Ignore => {}
            LockMode::Write => drop(text.line(format!("lock file: {}", lock.display()))),
            LockMode::Check => drop(text.line(format!("all results are those of {}", lock.display()))),
        }
        // The pipeline in the file does not have the stages of a sweep.
        if self.command == Command::Run {
            let report = || format!("deaflow report {} -o report", self.of.shell_words());
            text.command(format!("next: {}", pull.unwrap_or_else(report)));
        }
    }

    /// Returns the command that fetches stages whose artifacts are on a remote only, which a report needs here.
    fn pull(&self, elsewhere: &[StageArtifact], remote: Option<&Remote>) -> Option<String> {
        let remote = remote.filter(|_| !elsewhere.is_empty())?;
        Some(format!(
            "deaflow pull {} --remote {}",
            self.of.shell_words(),
            remote.name()
        ))
    }
}

/// Draws the figures while stages run: from the first one that is built, since a run that builds nothing has all
/// figures.
#[derive(Default)]
struct Preparation {
    /// Stages that were reused before that.
    reused: Mutex<Vec<StageArtifact>>,
    figures: OnceLock<Option<BackgroundFigures>>,
}

impl Preparation {
    fn update(&self, event: &Event, start: impl FnOnce() -> Option<BackgroundFigures>) {
        let (stage, is_new) = match event {
            Event::StageStarted { .. } => {
                self.figures.get_or_init(|| {
                    let figures = start()?;
                    for made in self.reused().drain(..) {
                        figures.add(made, false);
                    }
                    Some(figures)
                });
                return;
            }
            Event::StageFinished(stage) => (stage, true),
            Event::StageReused(stage) => (stage, false),
            _ => return,
        };
        match (self.figures.get(), made_by(stage)) {
            (Some(Some(figures)), Some(made)) => figures.add(made, is_new),
            (None, Some(made)) => self.reused().push(made),
            _ => {}
        }
    }

    /// A panic of another thread leaves a valid list: it is pushed to in one step.
    fn reused(&self) -> MutexGuard<'_, Vec<StageArtifact>> {
        self.reused.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn finish(self) {
        if let Some(Some(figures)) = self.figures.into_inner() {
            figures.finish();
        }
    }
}

/// Starts the thread that draws figures; none with `--jobs 1`, or if the system refuses: then all is done at the end.
fn figures_of(pipeline: &Pipeline, store: &Store) -> Option<BackgroundFigures> {
    if rayon::current_num_threads() == 1 {
        return None;
    }
    BackgroundFigures::start(store.without_upstream(), pipeline.file(), pipeline.name.clone()).ok()
}

/// Whether an artifact is in the store itself, with all its chunks.
fn is_here(store: &Store, digest: &ArtifactId) -> bool {
    let here = store.without_upstream();
    here.has(digest)
        && here
            .parts(digest)
            .is_ok_and(|parts| parts.iter().all(|part| here.has(part)))
}

fn made_by(stage: &StageReport) -> Option<StageArtifact> {
    Some(StageArtifact {
        stage: stage.name.clone(),
        kind: stage.kind.clone(),
        digest: stage.digest?,
    })
}

fn document(outcome: &RunOutcome) -> Value {
    json!({ "stages": outcome.stages, "unstable": outcome.unstable, "warnings": outcome.warnings })
}

fn results_document(outcome: &RunOutcome, results: &RunResults) -> Value {
    let mut document = document(outcome);
    for (key, value) in results.document() {
        document[key] = value;
    }
    // Warnings of the plan come first.
    let found = document["warnings"].as_array().into_iter().flatten().cloned();
    document["warnings"] = outcome.warnings.iter().map(|text| json!(text)).chain(found).collect();
    document
}
