//! `deaflow run --executor`: lets workers on other machines build, and shows their progress.

use std::fs;
use std::io;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf, absolute};
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use clap::{Args, ValueEnum};
use serde_json::json;
use signal_hook::consts::{SIGHUP, SIGINT};

use super::arguments::PipelineArguments;
use super::local_build::{Build, LockMode};
use super::output::print_plain;
use super::pipeline::read_lock;
use super::progress::{Bar, ProgressMode};
use super::upstream::StoreAccess;
use super::{CliError, Exit, Output, signals, table};
use deaflow_base::{Document, Progress, own_command, own_process, printable_json};
use deaflow_executor::{
    CommandEngine, Ending, Engine, EngineKind, Failed, LEDGER, Ledger, Profile, SlurmEngine, Submission,
    SubmissionStatus, SubmitOptions, supervise, topic,
};
use deaflow_orchestrator::{Pipeline, Readiness, check_locked, stage_progress};
use deaflow_stage as stage;
use deaflow_store::{Board, LockFile, Store};

/// The log of a detached submitter, in the folder of the logs of its workers.
const LOG: &str = "submitter.log";

#[derive(Debug, Default, Args)]
pub struct ClusterArguments {
    /// Build by workers on other machines [default: the executor of the profile]
    #[arg(long, value_enum, value_name = "ENGINE", help_heading = "Clusters")]
    pub executor: Option<Executor>,
    /// Resources of workers: a YAML file
    #[arg(long, value_name = "FILE", help_heading = "Clusters")]
    pub profile: Option<PathBuf>,
    /// The command that starts workers of `--executor command`: {worker} stands for the command line of a worker, and
    /// `n` in braces for their number
    #[arg(long, value_name = "COMMAND", help_heading = "Clusters")]
    pub submit: Option<String>,
    /// Submit and return; `deaflow attach` shows the progress
    #[arg(long, help_heading = "Clusters", conflicts_with_all = ["lock", "locked", "verify"])]
    pub detach: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Executor {
    /// sbatch, squeue, scancel
    Slurm,
    /// Any engine, started by the command of --submit or of the profile
    Command,
}

impl ClusterArguments {
    fn is_given(&self) -> bool {
        self.executor.is_some() || self.profile.is_some() || self.submit.is_some()
    }
}

/// A pipeline that workers build.
pub struct ClusterBuild<'a> {
    pub pipeline: &'a Pipeline,
    pub of: &'a PipelineArguments,
    pub store: &'a Store,
    pub mode: ProgressMode,
}

/// Lets workers build, if requested. Returns none if not, or when everything is built: this process then reports as any
/// run.
///
/// # Errors
/// When the workers cannot be submitted, or fail.
pub fn build(build: &Build<'_>, cluster: &ClusterArguments, output: &Output) -> Result<Option<Exit>, CliError> {
    if !cluster.is_given() {
        return match cluster.detach {
            true => Err(CliError::bad_input("--detach needs workers").help("add --executor, --profile or --submit")),
            false => Ok(None),
        };
    }
    let profile = match &cluster.profile {
        Some(path) => Some((path.display().to_string(), Document::text(path)?)),
        None => None,
    };
    let options = SubmitOptions {
        engine: match cluster.executor {
            Some(Executor::Slurm) => "slurm".to_owned(),
            Some(Executor::Command) => "command".to_owned(),
            None => String::new(),
        },
        profile,
        submit: cluster.submit.clone(),
        until: build.of.until.clone(),
        keep_going: build.keep_going,
    };
    let access = StoreAccess::open(Store::open(&build.of.store_folder())?, build.of, output)?;
    if build.lock == LockMode::Check {
        let lock = read_lock(&LockFile::path_for(&build.pipeline.path))?;
        check_locked(build.pipeline, build.of.until.as_deref(), access.store(), &lock)?;
    }
    let workers = ClusterBuild {
        pipeline: build.pipeline,
        of: build.of,
        store: access.store(),
        mode: build.verbosity.progress.mode(),
    };
    let stay = if cluster.detach {
        Stay::UntilSubmitted
    } else {
        Stay::UntilBuilt
    };
    workers.submit(options, stay, output)
}

/// How long a submitter stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stay {
    /// Until everything is built.
    UntilBuilt,
    /// Until workers have been submitted.
    UntilSubmitted,
    /// Until everything is built, for a process that has submitted the workers.
    ForOther,
}

impl ClusterBuild<'_> {
    /// Submits workers and follows them. Returns none when everything is built.
    ///
    /// # Errors
    /// When the workers cannot be submitted, or fail.
    pub fn submit(&self, options: SubmitOptions, stay: Stay, output: &Output) -> Result<Option<Exit>, CliError> {
        let (profile, kind) = self.profile(&options)?;
        let stages = stage_progress(self.pipeline, self.store, options.until.as_deref())?;
        if stages.iter().all(|stage| stage.readiness == Readiness::Built) {
            return Ok(None);
        }
        let engine = engine(&profile, kind, options.submit.clone())?;
        let cancel = Arc::new(AtomicBool::new(false));
        signals::set_on(SIGINT, &cancel)?;
        // Closing the terminal does not cancel.
        signals::ignore(SIGHUP)?;
        let display = ClusterDisplay::new(self.mode, &self.pipeline.name);
        let submission = Submission {
            pipeline: self.pipeline,
            store: self.store,
            profile: &profile,
            engine: engine.as_ref(),
            worker: &self.worker(&profile)?,
            options,
            cancel: &cancel,
            once: stay == Stay::UntilSubmitted,
            is_continuation: stay == Stay::ForOther,
        };
        let ending = supervise(&submission, &|status| display.show(status))?;
        display.end();
        match ending {
            Ending::Done => {
                // The report remains; the first Ctrl-C ends it.
                cancel.store(true, Ordering::Relaxed);
                Ok(None)
            }
            Ending::Refused(why) => Err(CliError::failure(format!("the engine refused the workers: {why}"))),
            Ending::Submitted(arrays) => self.detach(&arrays, output).map(Some),
            Ending::Left(arrays) => {
                let arrays = match arrays.is_empty() {
                    true => "no workers yet".to_owned(),
                    false => arrays.join(", "),
                };
                output.note(&format!(
                    "another process is building this pipeline (submitted: {arrays}); cancel it with `deaflow attach \
                     {} --cancel`",
                    self.of.pipeline.display()
                ));
                Ok(Some(if stay == Stay::UntilSubmitted {
                    Exit::Done
                } else {
                    Exit::TryAgain
                }))
            }
            Ending::Failed(failures) => Ok(Some(failed(&failures, output)?)),
            Ending::Cancelled(None) => Err(CliError::failure("cancelled; finished work is kept").transient()),
            Ending::Cancelled(Some(error)) => Err(CliError::failure(format!("cannot cancel all workers: {error}"))
                .help("try again: deaflow attach PIPELINE --cancel")),
            Ending::GivenUp(stages, problem) => {
                let why = problem.map_or(String::new(), |problem| format!("; last message: {problem}"));
                let logs = self.board(submission.options.until.as_deref()).logs()?;
                Err(CliError::failure(format!(
                    "workers on {} repeatedly end without progress{why}",
                    stages.join(", ")
                ))
                .help(format!("see their logs in {}", logs.display()))
                .transient())
            }
        }
    }

    fn board(&self, until: Option<&str>) -> Board {
        self.store.board(&topic(self.pipeline, until))
    }

    /// Reads what was last submitted for the pipeline.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn ledger(&self) -> Result<Option<Ledger>, CliError> {
        Ok(self.board(self.of.until.as_deref()).read(LEDGER)?)
    }

    /// Cancels all submitted workers.
    ///
    /// # Errors
    /// When they are those of another user, or some could not be cancelled.
    pub fn cancel(&self, options: &SubmitOptions, output: &Output) -> Result<Exit, CliError> {
        if !self.board(options.until.as_deref()).is_own(LEDGER) {
            return Err(CliError::failure(
                "cannot cancel: the workers were submitted by another user",
            ));
        }
        let (profile, kind) = self.profile(options)?;
        let engine = engine(&profile, kind, options.submit.clone())?;
        let arrays = deaflow_executor::cancel(&self.board(options.until.as_deref()), engine.as_ref())?;
        let arrays = arrays.map_err(|error| CliError::failure(format!("cannot cancel all workers: {error}")))?;
        let name = &self.pipeline.name;
        output.result(
            || json!({ "pipeline": name, "cancelled": arrays }),
            || {
                format!(
                    "{name}: {} of workers cancelled",
                    table::counted(arrays as u64, "arrays")
                )
            },
        )
    }

    fn profile(&self, options: &SubmitOptions) -> Result<(Profile, EngineKind), CliError> {
        let profile = match &options.profile {
            Some((path, text)) => {
                let registry = stage::registry();
                let kinds: Vec<&str> = registry.kinds.iter().map(|kind| kind.name()).collect();
                Profile::read(Path::new(path), text, self.pipeline, &kinds)?
            }
            None => Profile::default(),
        };
        let kind = match options.engine.as_str() {
            "slurm" => EngineKind::Slurm,
            "command" => EngineKind::Command,
            _ => match (profile.engine, &options.submit) {
                (Some(kind), _) => kind,
                (None, Some(_)) => EngineKind::Command,
                (None, None) => {
                    return Err(CliError::bad_input("no engine to start workers with")
                        .help("add --executor slurm, or `executor: slurm` to the profile"));
                }
            },
        };
        if kind == EngineKind::Slurm && options.submit.is_some() {
            return Err(CliError::bad_input(
                "--submit needs --executor command; the executor is slurm",
            ));
        }
        Ok((profile, kind))
    }

    /// The command line of a worker, without its stages and its array. Paths are absolute: workers start in other
    /// folders.
    fn worker(&self, profile: &Profile) -> Result<Vec<String>, CliError> {
        let own = own_command().map_err(|error| CliError::failure(format!("cannot find this program: {error}")))?;
        let own = own.iter().map(|word| text(word.as_ref()));
        let mut words = own.collect::<Result<Vec<String>, CliError>>()?;
        words.push("worker".to_owned());
        words.extend(self.arguments()?);
        words.extend(["--cpu".to_owned(), profile.cpu.name().to_owned()]);
        Ok(words)
    }

    /// The pipeline and its options as arguments of a command in any folder.
    fn arguments(&self) -> Result<Vec<String>, CliError> {
        let PipelineArguments {
            pipeline,
            until,
            set,
            remote,
            ..
        } = self.of;
        let mut words = vec![
            text(&full(pipeline)?)?,
            "--store".to_owned(),
            text(&full(&self.of.store_folder())?)?,
        ];
        let pair = |name: &str, value: &String| [name.to_owned(), value.clone()];
        words.extend(until.iter().flat_map(|until| pair("--until", until)));
        words.extend(set.with_absolute_paths().iter().flat_map(|set| pair("--set", set)));
        words.extend(set.many.then(|| "--many".to_owned()));
        words.extend(remote.name().iter().flat_map(|name| pair("--remote", name)));
        Ok(words)
    }

    /// Continues in a background process.
    fn detach(&self, arrays: &[String], output: &Output) -> Result<Exit, CliError> {
        let log = self.board(self.of.until.as_deref()).logs()?.join(LOG);
        let refused = |error: io::Error| CliError::failure(format!("cannot continue in the background: {error}"));
        let file = fs::File::options()
            .create(true)
            .append(true)
            .open(&log)
            .map_err(refused)?;
        let mut command = own_process().map_err(refused)?;
        command
            .arg("attach")
            .args(self.arguments()?)
            .args(["--go-on", "--progress", "plain"])
            .stdin(Stdio::null())
            .stdout(file.try_clone().map_err(refused)?)
            .stderr(file)
            .process_group(0);
        let child = command.spawn().map_err(refused)?;
        let document = || {
            json!({
                "pipeline": self.pipeline.name,
                "store": self.store.root(),
                "arrays": arrays,
                "submitter": child.id(),
                "log": log,
            })
        };
        output.result(document, || {
            format!(
                "submitted {}; process {} continues and writes {}\nshow the progress: deaflow attach {}",
                arrays.join(", "),
                child.id(),
                log.display(),
                self.of.pipeline.display()
            )
        })
    }
}

fn full(path: &Path) -> Result<PathBuf, CliError> {
    absolute(path).map_err(|error| CliError::bad_input(format!("{}: {error}", path.display())))
}

fn text(path: &Path) -> Result<String, CliError> {
    let text = path.to_str();
    text.map(str::to_owned)
        .ok_or_else(|| CliError::bad_input(format!("{}: the path is not UTF-8", path.display())))
}

fn engine(profile: &Profile, kind: EngineKind, submit: Option<String>) -> Result<Box<dyn Engine>, CliError> {
    let environment = profile.environment.clone();
    match kind {
        EngineKind::Slurm => match SlurmEngine::find(profile.slurm.clone(), environment) {
            Ok(engine) => Ok(Box::new(engine)),
            Err(error) => Err(CliError::failure(format!("there is no Slurm here: {error}"))
                .help("submit from a node with sbatch and squeue")),
        },
        EngineKind::Command => {
            let submit = submit.or_else(|| profile.submit.clone());
            let submit = submit.ok_or_else(|| {
                CliError::bad_input("no command to start workers with")
                    .help("add --submit './submit.sh {n} {worker}', or `command: { submit: … }` to the profile")
            })?;
            match CommandEngine::new(submit, profile.cancel.clone(), environment) {
                Ok(engine) => Ok(Box::new(engine)),
                Err(reason) => Err(CliError::bad_input(format!("--submit: {reason}"))),
            }
        }
    }
}

/// Reports the failures of workers. The first one decides how the run ends.
fn failed(failures: &[Failed], output: &Output) -> Result<Exit, CliError> {
    let exits = [
        Exit::BadInput,
        Exit::Unstable,
        Exit::Damaged,
        Exit::Findings,
        Exit::Locked,
    ];
    let exit = |code: u8| {
        exits
            .into_iter()
            .find(|exit| exit.code() == code)
            .unwrap_or(Exit::Failure)
    };
    if output.is_json() {
        let errors = failures
            .iter()
            .map(|failed| json!({ "stage": failed.stage, "message": failed.message }));
        output.document(&json!({ "errors": errors.collect::<Vec<_>>() }))?;
    }
    for failed in failures {
        output.note(&format!("error: {}", failed.message));
    }
    Ok(failures.first().map_or(Exit::Failure, |failed| exit(failed.exit)))
}

/// The progress of all workers, in one bar.
struct ClusterDisplay {
    mode: ProgressMode,
    bar: Option<Bar>,
    last: Mutex<LastReport>,
}

/// What has been reported already.
#[derive(Default)]
struct LastReport {
    built: Option<Vec<String>>,
    problem: Option<String>,
    counts: (u64, u64, u32),
    follows: bool,
}

impl ClusterDisplay {
    fn new(mode: ProgressMode, pipeline: &str) -> Self {
        Self {
            mode,
            bar: Bar::with_mode(mode, pipeline, "pieces"),
            last: Mutex::default(),
        }
    }

    fn show(&self, status: &SubmissionStatus<'_>) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let stages = status.stages;
        let done: u64 = stages.iter().map(|stage| stage.done).sum();
        let pieces: u64 = stages.iter().map(|stage| stage.pieces).sum();
        let built = stages.iter().filter(|stage| stage.readiness == Readiness::Built);
        let built: Vec<String> = built.map(|stage| stage.name.clone()).collect();
        let counts = (done, pieces, status.workers);
        let problem = status
            .trouble
            .filter(|problem| last.problem.as_deref() != Some(*problem));
        if self.mode == ProgressMode::Json && last.counts != counts {
            let document = json!({
                "event": "cluster",
                "done": done,
                "pieces": pieces,
                "workers": status.workers,
                "there": built,
            });
            print_plain(&printable_json(&document.to_string()));
        }
        match (problem, self.mode) {
            (Some(problem), ProgressMode::Json) => {
                let warning = json!({ "event": "warning", "text": problem });
                print_plain(&printable_json(&warning.to_string()));
            }
            (Some(problem), _) => self.print(&format!("warning: {problem}")),
            (None, _) => {}
        }
        if let Some(bar) = &self.bar {
            if status.follows && !last.follows {
                self.print("another process has submitted this pipeline; following it");
            }
            let new = built
                .iter()
                .filter(|name| last.built.as_ref().is_some_and(|known| !known.contains(name)));
            new.for_each(|name| self.print(&format!("{name}: built")));
            bar.set(done, pieces);
            let running = stages.iter().filter(|stage| stage.readiness == Readiness::Ready);
            let running = running.map(|stage| format!("{} {}/{}", stage.name, stage.done, stage.pieces));
            let running: Vec<String> = running.take(3).collect();
            bar.note(&format!("{} workers; {}", status.workers, running.join(", ")));
        }
        last.problem = status.trouble.map(str::to_owned);
        last.follows = status.follows;
        last.counts = counts;
        last.built = Some(built);
    }

    fn print(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.print(text),
            None => print_plain(text),
        }
    }

    fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.clear();
        }
    }
}
