//! `deaflow run --executor`: has workers on other machines build, shows how far they are, and then tells what was found as any run does.

use std::fs;
use std::io;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf, absolute};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use clap::{Args, ValueEnum};
use serde_json::json;
use signal_hook::consts::{SIGHUP, SIGINT};

use super::arguments::PipelineArguments;
use super::error::CliError;
use super::output::{Exit, Output, tell};
use super::progress::{Bar, Shown};
use super::run::{ProgressForm, RunArguments, read_lock};
use super::signals;
use deaflow_base::{Document, Progress, printable_json};
use deaflow_executor::{
    CommandEngine, Ending, Engine, EngineKind, Failed, LEDGER, Ledger, Profile, Recipe, SlurmEngine, Standings,
    Submission, supervise, topic,
};
use deaflow_orchestrator::{Pipeline, Readiness, check_locked, stage_progress};
use deaflow_stage as stage;
use deaflow_store::{Board, LockFile, Store};

/// Where a detached submitter writes, among the logs of its workers.
const LOG: &str = "submitter.log";

#[derive(Debug, Default, Args)]
pub struct ClusterArguments {
    /// Have workers on other machines build [default: as the profile says]
    #[arg(long, value_enum, value_name = "ENGINE", help_heading = "Clusters")]
    pub executor: Option<Executor>,
    /// What workers get and where: a YAML file
    #[arg(long, value_name = "FILE", help_heading = "Clusters")]
    pub profile: Option<PathBuf>,
    /// The command that starts workers of `--executor command`, with fields in braces for their number and command line
    #[arg(long, value_name = "COMMAND", help_heading = "Clusters")]
    pub submit: Option<String>,
    /// Submit and come back: `deaflow attach` shows how far they are
    #[arg(long, help_heading = "Clusters", conflicts_with_all = ["lock", "locked", "verify"])]
    pub detach: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Executor {
    /// sbatch, squeue, scancel
    Slurm,
    /// Any engine, by the command of --submit or of the profile
    Command,
}

impl ClusterArguments {
    fn is_asked_for(&self) -> bool {
        self.executor.is_some() || self.profile.is_some() || self.submit.is_some()
    }
}

/// What is to be built by others, and for whom that is shown.
pub struct Work<'a> {
    pub pipeline: &'a Pipeline,
    pub of: &'a PipelineArguments,
    pub store: &'a Store,
    pub shown: Shown,
}

/// Has others build where that is asked for. None where it is not, or all is there then: the rest is that of any run.
pub fn build(pipeline: &Pipeline, arguments: &RunArguments, output: &Output) -> Result<Option<Exit>, CliError> {
    let cluster = &arguments.cluster;
    if !cluster.is_asked_for() {
        return match cluster.detach {
            true => Err(CliError::bad_input("--detach: there are no workers to come back from")
                .help("--executor, --profile or --submit says who builds")),
            false => Ok(None),
        };
    }
    let profile = match &cluster.profile {
        Some(path) => Some((path.display().to_string(), Document::text(path)?)),
        None => None,
    };
    let recipe = Recipe {
        engine: match cluster.executor {
            Some(Executor::Slurm) => "slurm".to_owned(),
            Some(Executor::Command) => "command".to_owned(),
            None => String::new(),
        },
        profile,
        submit: cluster.submit.clone(),
        until: arguments.of.until.clone(),
        keep_going: arguments.keep_going,
    };
    let reading = arguments.of.read(Store::open(&arguments.of.store_folder())?, output)?;
    let store = reading.store();
    if arguments.locked {
        let lock = read_lock(&LockFile::path_for(&pipeline.path))?;
        check_locked(pipeline, arguments.of.until.as_deref(), store, &lock)?;
    }
    let work = Work {
        pipeline,
        of: &arguments.of,
        store,
        shown: ProgressForm::shown(arguments.progress, arguments.quiet),
    };
    let how = if cluster.detach { How::Detach } else { How::Stay };
    work.submit(recipe, how, output)
}

/// How long a submitter stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum How {
    /// Until all is there.
    Stay,
    /// Until workers have been submitted.
    Detach,
    /// Until all is there, for another that has submitted them.
    GoOn,
}

impl Work<'_> {
    /// Goes on with what a recipe says until all is there, which gives none.
    pub fn submit(&self, recipe: Recipe, how: How, output: &Output) -> Result<Option<Exit>, CliError> {
        let (profile, kind) = self.profile(&recipe)?;
        let stages = stage_progress(self.pipeline, self.store, recipe.until.as_deref())?;
        if stages.iter().all(|stage| stage.readiness == Readiness::Built) {
            return Ok(None);
        }
        let engine = engine(&profile, kind, recipe.submit.clone())?;
        let cancel = Arc::new(AtomicBool::new(false));
        signals::heed(SIGINT, &cancel)?;
        // A terminal that is closed is no wish to cancel.
        signals::ignore(SIGHUP)?;
        let display = Display::new(self.shown, &self.pipeline.name);
        let submission = Submission {
            pipeline: self.pipeline,
            store: self.store,
            profile: &profile,
            engine: engine.as_ref(),
            worker: &self.worker(&profile)?,
            recipe,
            cancel: &cancel,
            once: how == How::Detach,
            goes_on: how == How::GoOn,
        };
        let ending = supervise(&submission, &|standings| display.show(standings))?;
        display.end();
        match ending {
            Ending::Done => {
                // What is left is done here: the first Ctrl-C ends it.
                cancel.store(true, Ordering::Relaxed);
                Ok(None)
            }
            Ending::Refused(why) => Err(CliError::failure(format!("the workers were not taken: {why}"))),
            Ending::Submitted(arrays) => self.detach(&arrays, output).map(Some),
            Ending::Left(arrays) => {
                let arrays = if arrays.is_empty() {
                    "nothing yet".to_owned()
                } else {
                    arrays.join(", ")
                };
                output.complain(&format!(
                    "another process has submitted {arrays} and goes on; `deaflow attach {} --cancel` ends it",
                    self.of.pipeline.display()
                ));
                Ok(Some(if how == How::Detach { Exit::Done } else { Exit::TryAgain }))
            }
            Ending::Failed(failures) => Ok(Some(failed(&failures, output)?)),
            Ending::Cancelled(None) => Err(CliError::failure("cancelled; what has been built is kept").elsewhere()),
            Ending::Cancelled(Some(error)) => {
                Err(CliError::failure(format!("not everything could be cancelled: {error}"))
                    .help("`deaflow attach PIPELINE --cancel` tries again"))
            }
            Ending::GivenUp(stages, trouble) => {
                let why = trouble.map_or(String::new(), |trouble| format!("; the last said: {trouble}"));
                let logs = self.board(submission.recipe.until.as_deref()).logs()?;
                Err(CliError::failure(format!(
                    "workers on {} end again and again without bringing anything about{why}",
                    stages.join(", ")
                ))
                .help(format!("what they said stands in {}", logs.display()))
                .elsewhere())
            }
        }
    }

    fn board(&self, until: Option<&str>) -> Board {
        self.store.board(&topic(self.pipeline, until))
    }

    /// What was last submitted for the pipeline.
    pub fn ledger(&self) -> Result<Option<Ledger>, CliError> {
        Ok(self.board(self.of.until.as_deref()).read(LEDGER)?)
    }

    /// Ends all workers that were submitted.
    pub fn cancel(&self, recipe: &Recipe, output: &Output) -> Result<Exit, CliError> {
        if !self.board(recipe.until.as_deref()).is_own(LEDGER) {
            return Err(CliError::failure(
                "another user has submitted this: only that one can cancel it",
            ));
        }
        let (profile, kind) = self.profile(recipe)?;
        let engine = engine(&profile, kind, recipe.submit.clone())?;
        let arrays = deaflow_executor::cancel(&self.board(recipe.until.as_deref()), engine.as_ref())?;
        let arrays =
            arrays.map_err(|error| CliError::failure(format!("not everything could be cancelled: {error}")))?;
        match output.is_json() {
            true => output.document(&json!({ "pipeline": self.pipeline.name, "cancelled": arrays }))?,
            false => output.text(format!("{}: {arrays} arrays of workers cancelled", self.pipeline.name))?,
        }
        Ok(Exit::Done)
    }

    fn profile(&self, recipe: &Recipe) -> Result<(Profile, EngineKind), CliError> {
        let profile = match &recipe.profile {
            Some((path, text)) => {
                let registry = stage::registry();
                let kinds: Vec<&str> = registry.kinds.iter().map(|kind| kind.name()).collect();
                Profile::read(Path::new(path), text, self.pipeline, &kinds)?
            }
            None => Profile::default(),
        };
        let kind = match recipe.engine.as_str() {
            "slurm" => EngineKind::Slurm,
            "command" => EngineKind::Command,
            _ => match (profile.engine, &recipe.submit) {
                (Some(kind), _) => kind,
                (None, Some(_)) => EngineKind::Command,
                (None, None) => {
                    return Err(CliError::bad_input("nothing says which engine starts workers")
                        .help("--executor slurm, or `executor: slurm` in the profile"));
                }
            },
        };
        if kind == EngineKind::Slurm && recipe.submit.is_some() {
            return Err(CliError::bad_input(
                "--submit is of --executor command, and the executor is slurm",
            ));
        }
        Ok((profile, kind))
    }

    /// The command line of a worker, but for its stages and its array. Workers start in folders of their own.
    fn worker(&self, profile: &Profile) -> Result<Vec<String>, CliError> {
        let own =
            std::env::current_exe().map_err(|error| CliError::failure(format!("where this program is: {error}")))?;
        let mut words = vec![text(&own)?, "worker".to_owned()];
        words.extend(self.arguments()?);
        words.extend(["--cpu".to_owned(), profile.cpu.word().to_owned()]);
        Ok(words)
    }

    /// The pipeline as it was given, as arguments of another command wherever that is started.
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
        words.extend(set.named_from_root().iter().flat_map(|set| pair("--set", set)));
        words.extend(set.many.then(|| "--many".to_owned()));
        words.extend(remote.name().iter().flat_map(|name| pair("--remote", name)));
        Ok(words)
    }

    /// Leaves the rest to a process that no terminal ends.
    fn detach(&self, arrays: &[String], output: &Output) -> Result<Exit, CliError> {
        let log = self.board(self.of.until.as_deref()).logs()?.join(LOG);
        let refused = |error: io::Error| CliError::failure(format!("cannot go on in the background: {error}"));
        let file = fs::File::options()
            .create(true)
            .append(true)
            .open(&log)
            .map_err(refused)?;
        let own = std::env::current_exe().map_err(refused)?;
        let mut command = Command::new(own);
        command
            .arg("attach")
            .args(self.arguments()?)
            .args(["--go-on", "--progress", "plain"])
            .stdin(Stdio::null())
            .stdout(file.try_clone().map_err(refused)?)
            .stderr(file)
            .process_group(0);
        let child = command.spawn().map_err(refused)?;
        match output.is_json() {
            true => output.document(&json!({
                "pipeline": self.pipeline.name,
                "store": self.store.root(),
                "arrays": arrays,
                "submitter": child.id(),
                "log": log,
            }))?,
            false => output.text(format!(
                "submitted {}; process {} goes on and writes {}\n`deaflow attach {}` shows how far they are",
                arrays.join(", "),
                child.id(),
                log.display(),
                self.of.pipeline.display()
            ))?,
        }
        Ok(Exit::Done)
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
                .help("a node from which sbatch and squeue work submits")),
        },
        EngineKind::Command => {
            let submit = submit.or_else(|| profile.submit.clone());
            let submit = submit.ok_or_else(|| {
                CliError::bad_input("nothing says how workers are started")
                    .help("--submit './submit.sh {n} {worker}', or `command: { submit: … }` in the profile")
            })?;
            match CommandEngine::new(submit, profile.cancel.clone(), environment) {
                Ok(engine) => Ok(Box::new(engine)),
                Err(reason) => Err(CliError::bad_input(format!("--submit: {reason}"))),
            }
        }
    }
}

/// What workers said of stages that cannot be built. The first of them decides how the run ends.
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
        output.complain(&format!("error: {}", failed.message));
    }
    Ok(failures.first().map_or(Exit::Failure, |failed| exit(failed.exit)))
}

/// One bar for the work of all.
struct Display {
    shown: Shown,
    bar: Option<Bar>,
    said: Mutex<Said>,
}

/// What has been told already.
#[derive(Default)]
struct Said {
    there: Option<Vec<String>>,
    trouble: Option<String>,
    counts: (u64, u64, u32),
    follows: bool,
}

impl Display {
    fn new(shown: Shown, pipeline: &str) -> Self {
        Self {
            shown,
            bar: Bar::of(shown, pipeline, "pieces"),
            said: Mutex::default(),
        }
    }

    fn show(&self, standings: &Standings<'_>) {
        let mut said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        let stages = standings.stages;
        let done: u64 = stages.iter().map(|stage| stage.done).sum();
        let pieces: u64 = stages.iter().map(|stage| stage.pieces).sum();
        let there = stages.iter().filter(|stage| stage.readiness == Readiness::Built);
        let there: Vec<String> = there.map(|stage| stage.name.clone()).collect();
        let counts = (done, pieces, standings.workers);
        let trouble = standings
            .trouble
            .filter(|trouble| said.trouble.as_deref() != Some(*trouble));
        if self.shown == Shown::Json && said.counts != counts {
            let document = json!({
                "event": "cluster",
                "done": done,
                "pieces": pieces,
                "workers": standings.workers,
                "there": there,
            });
            tell(&printable_json(&document.to_string()));
        }
        match (trouble, self.shown) {
            (Some(trouble), Shown::Json) => {
                let warning = json!({ "event": "warning", "text": trouble });
                tell(&printable_json(&warning.to_string()));
            }
            (Some(trouble), _) => self.say(&format!("warning: {trouble}")),
            (None, _) => {}
        }
        if let Some(bar) = &self.bar {
            if standings.follows && !said.follows {
                self.say("another process has submitted this; following it");
            }
            let new = there
                .iter()
                .filter(|name| said.there.as_ref().is_some_and(|said| !said.contains(name)));
            new.for_each(|name| self.say(&format!("{name}: there")));
            bar.set(done, pieces);
            let at_work = stages.iter().filter(|stage| stage.readiness == Readiness::Ready);
            let at_work = at_work.map(|stage| format!("{} {}/{}", stage.name, stage.done, stage.pieces));
            let at_work: Vec<String> = at_work.take(3).collect();
            bar.note(&format!("{} workers; {}", standings.workers, at_work.join(", ")));
        }
        said.trouble = standings.trouble.map(str::to_owned);
        said.follows = standings.follows;
        said.counts = counts;
        said.there = Some(there);
    }

    fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.say(text),
            None => tell(text),
        }
    }

    fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.clear();
        }
    }
}
