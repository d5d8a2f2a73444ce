//! Has an engine keep as many workers as there is work, until everything is there.
//!
//! Nothing that an engine says decides what has been built: a stage is there when its record verifies. An engine that does not answer
//! says nothing of its workers.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime};

use serde::{Deserialize, Serialize};

use super::engine::{Engine, EngineError, Request};
use super::ledger::{Array, LEDGER, Ledger, Recipe};
use super::profile::{Profile, Resources};
use super::workers::{SILENT, workers};
use deaflow_base::{Digest, host_name};
use deaflow_orchestrator::{Pipeline, Readiness, RunError, StageProgress, Sweep, stage_progress};
use deaflow_store::{Board, Guard, Store, StoreError};

/// Between two looks at the store; longer where a look takes long.
const LOOK: Duration = Duration::from_millis(500);

/// A look takes no more than about this part of the time: one in so many.
const SHARE: u32 = 5;

/// An engine is asked no sooner again, and no later.
const ASK: (Duration, Duration) = (Duration::from_secs(10), Duration::from_secs(30));

/// What a note of a failure begins with.
const FAILED: &str = "failed-";

/// The note on what last ended a worker that is to be started again.
const TROUBLE: &str = "trouble";

/// The note that everything is to be cancelled.
const CANCELLED: &str = "cancelled";

/// What a note of a worker that has begun begins with, before its array.
const BEGAN: &str = "began-";

/// What a note of an array begins with that found only what others build.
const LEFT: &str = "left-";

/// An array of which nobody has begun for so long is worth a word.
const WAITING: Duration = Duration::from_secs(600);

/// The longest time before workers are started again after some that brought nothing about.
const BACK_OFF: Duration = Duration::from_secs(600);

/// So often in a row the store may refuse to be looked at.
const REFUSALS: u32 = 20;

/// A submission.
pub struct Submission<'a> {
    /// What is to be built.
    pub pipeline: &'a Pipeline,
    /// Where.
    pub store: &'a Store,
    /// What each stage gets.
    pub profile: &'a Profile,
    /// By whom.
    pub engine: &'a dyn Engine,
    /// The command line of a worker, but for its stages and its array.
    pub worker: &'a [String],
    /// How to go on with it.
    pub recipe: Recipe,
    /// Once it is set everything is cancelled.
    pub cancel: &'a AtomicBool,
    /// Whether to end once workers have been submitted.
    pub once: bool,
    /// Whether it only goes on with what another process has submitted: then what was cancelled stays so.
    pub goes_on: bool,
}

/// A stage that no worker can build, as one of them found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failed {
    /// The stage, if it is that of one.
    pub stage: Option<String>,
    /// The exit code of the worker.
    pub exit: u8,
    /// Why.
    pub message: String,
}

/// How a submission stands.
pub struct Standings<'a> {
    /// Its stages.
    pub stages: &'a [StageProgress],
    /// Workers that wait or work, as far as is known.
    pub workers: u32,
    /// What the engine last said that was no answer.
    pub trouble: Option<&'a str>,
    /// Whether another submitter leads.
    pub follows: bool,
}

/// How a submission ended.
#[derive(Debug)]
pub enum Ending {
    /// Everything is there.
    Done,
    /// Workers have been submitted, and that is all that was asked for.
    Submitted(Vec<String>),
    /// Another submitter goes on with these arrays, and this one was not to wait for it.
    Left(Vec<String>),
    /// The engine did not take what was submitted, and to try once was all that was asked for.
    Refused(String),
    /// Some stages cannot be built.
    Failed(Vec<Failed>),
    /// It was cancelled, here or by another; workers that could not be.
    Cancelled(Option<EngineError>),
    /// Workers end again and again without bringing anything about: on which stages, and what the last of them said.
    GivenUp(Vec<String>, Option<String>),
}

/// Why a submission could not go on.
#[derive(Debug, thiserror::Error)]
pub enum SubmitError {
    /// The pipeline or the store.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// The topic of a pipeline in the notes of a store: what is to be built, wherever its file lies.
#[must_use]
pub fn topic(pipeline: &Pipeline, until: Option<&str>) -> String {
    let mut text = format!("{}\n{}\n", pipeline.name, until.unwrap_or_default());
    for stage in &pipeline.stages {
        let parameters = Digest::of(stage.stage.parameters().to_string().as_bytes());
        text += &format!("{} {} {parameters}\n", stage.name, stage.kind.name());
    }
    Digest::of(text.as_bytes()).short()
}

/// Lets submitters know what became of a worker that could not do all.
///
/// # Errors
/// When the system refuses.
pub fn report_failures(board: &Board, failures: &[Failed]) -> Result<(), StoreError> {
    for failed in failures {
        let of = failed.stage.as_deref().unwrap_or_default();
        board.write(&format!("{FAILED}{}", Digest::of(of.as_bytes()).short()), failed)?;
    }
    Ok(())
}

/// Lets submitters know why a worker is to be started again.
///
/// # Errors
/// When the system refuses.
pub fn report_trouble(board: &Board, message: &str) -> Result<(), StoreError> {
    board.write(TROUBLE, &message)
}

/// Lets submitters know that a worker of an array has begun.
///
/// # Errors
/// When the system refuses.
pub fn report_begun(board: &Board, array: &str) -> Result<(), StoreError> {
    let since = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default();
    let own = format!("{}-{}-{:x}", host_name(), std::process::id(), since.as_nanos());
    board.write(&format!("{BEGAN}{array}-{}", Digest::of(own.as_bytes()).short()), &true)
}

/// Lets submitters know that what was left for a worker of an array others are building: that it has brought nothing about says nothing.
///
/// # Errors
/// When the system refuses.
pub fn report_left(board: &Board, array: &str) -> Result<(), StoreError> {
    board.write(&format!("{LEFT}{array}"), &true)
}

/// Stages that get the same, and so are built by the same workers.
struct WorkerGroup {
    resources: Resources,
    stages: Vec<String>,
    /// How often in a row its workers brought nothing about, or were not taken.
    fruitless: u32,
    /// Why nothing is started before.
    until: Option<Instant>,
}

/// Has workers build all that is not there. `tell` is called at each look.
///
/// # Errors
/// When the pipeline cannot be read, or the store for long.
pub fn supervise(submission: &Submission<'_>, tell: &dyn Fn(&Standings<'_>)) -> Result<Ending, SubmitError> {
    let topic = topic(submission.pipeline, submission.recipe.until.as_deref());
    let board = submission.store.board(&topic);
    let mut supervisor = Supervisor {
        submission,
        ledger: Ledger::default(),
        groups: groups(submission)?,
        asked: None,
        interval: interval().0,
        trouble: None,
        // What was cancelled before this was asked for is begun anew once nobody else leads.
        is_new: !submission.goes_on,
        lead: None,
        board,
        topic,
    };
    let mut refused = 0;
    loop {
        let start = Instant::now();
        match supervisor.step(tell) {
            Ok(Some(ending)) => return Ok(ending),
            Ok(None) => refused = 0,
            // A network, a full disk: workers go on meanwhile.
            Err(SubmitError::Store(error) | SubmitError::Run(RunError::Store(error)))
                if error.is_transient() && refused < REFUSALS =>
            {
                refused += 1;
                supervisor.trouble = Some(error.to_string());
            }
            Err(error) => return Err(error),
        }
        let pause = LOOK.max(start.elapsed() * SHARE).max(LOOK * refused);
        let end = Instant::now() + pause;
        while Instant::now() < end && !submission.cancel.load(Ordering::Relaxed) {
            sleep(Duration::from_millis(50).min(pause));
        }
    }
}

/// Cancels all that has been submitted for a pipeline, whoever leads; gives the number of arrays, or why they could not be.
///
/// # Errors
/// When the store refuses.
pub fn cancel(board: &Board, engine: &dyn Engine) -> Result<Result<usize, EngineError>, StoreError> {
    let mut ledger: Ledger = board.read(LEDGER)?.unwrap_or_default();
    // First, so that who leads starts no more, and workers that nobody can end stop by themselves. Where it cannot be written, workers
    // are ended all the same.
    let noted = board.write(CANCELLED, &true);
    let cancelled = cancel_arrays(&ledger, engine);
    noted?;
    if cancelled.is_ok()
        && let Some(_lead) = board.try_lock()?
    {
        ledger.arrays.iter_mut().for_each(|array| array.living = 0);
        board.write(LEDGER, &ledger)?;
    }
    Ok(cancelled)
}

/// Whether what was submitted has been cancelled.
#[must_use]
pub fn is_cancelled(board: &Board) -> bool {
    board.has(CANCELLED)
}

fn cancel_arrays(ledger: &Ledger, engine: &dyn Engine) -> Result<usize, EngineError> {
    let living: Vec<(&str, Option<&str>)> = ledger
        .living()
        .map(|array| (array.name.as_str(), array.number.as_deref()))
        .collect();
    match living.as_slice() {
        [] => Ok(0),
        living => engine.cancel(living).map(|()| living.len()),
    }
}

/// How often an engine is asked. `DEAFLOW_ASK_SECONDS` is the shortest time, for tests.
fn interval() -> (Duration, Duration) {
    let seconds = std::env::var("DEAFLOW_ASK_SECONDS").ok();
    let seconds: Option<f64> = seconds.and_then(|seconds| seconds.parse().ok());
    match seconds.filter(|seconds| (0.05..=3600.0).contains(seconds)) {
        None => ASK,
        Some(seconds) => (Duration::from_secs_f64(seconds), Duration::from_secs_f64(3.0 * seconds)),
    }
}

fn groups(submission: &Submission<'_>) -> Result<Vec<WorkerGroup>, RunError> {
    let pipeline = submission.pipeline;
    let selection = pipeline.selection(submission.recipe.until.as_deref())?;
    let mut groups: BTreeMap<Resources, Vec<String>> = BTreeMap::new();
    for spec in selection.into_iter().map(|index| &pipeline.stages[index]) {
        let resources = submission.profile.resources(pipeline, spec);
        groups.entry(resources).or_default().push(spec.name.clone());
    }
    let group = |(resources, stages)| WorkerGroup {
        resources,
        stages,
        fruitless: 0,
        until: None,
    };
    Ok(groups.into_iter().map(group).collect())
}

struct Supervisor<'a> {
    submission: &'a Submission<'a>,
    topic: String,
    board: Board,
    ledger: Ledger,
    groups: Vec<WorkerGroup>,
    /// When the engine was last asked.
    asked: Option<Instant>,
    interval: Duration,
    trouble: Option<String>,
    /// Whether this has yet to begin anew, and not to go on with what was cancelled or failed.
    is_new: bool,
    lead: Option<Guard>,
}

impl Supervisor<'_> {
    /// One look, and what follows from it.
    fn step(&mut self, tell: &dyn Fn(&Standings<'_>)) -> Result<Option<Ending>, SubmitError> {
        let submission = self.submission;
        // What another user has submitted nobody else can ask for or cancel.
        if self.lead.is_none() && (!self.board.has(LEDGER) || self.board.is_own(LEDGER)) {
            self.lead = self.board.try_lock()?;
            if self.lead.is_some() {
                self.take_over()?;
            }
        }
        if self.lead.is_none() {
            self.ledger = self.board.read(LEDGER)?.unwrap_or_default();
        }
        let stages = stage_progress(
            submission.pipeline,
            submission.store,
            submission.recipe.until.as_deref(),
        )?;
        tell(&Standings {
            stages: &stages,
            workers: self.ledger.living().map(|array| array.living).sum(),
            trouble: self.trouble.as_deref(),
            follows: self.lead.is_none(),
        });
        match &self.lead {
            Some(_) => self.act(&stages),
            None => Ok(self.watch(&stages)?),
        }
    }

    /// Goes on with what is submitted already. What an earlier submission found of failures is found again if it is still true.
    fn take_over(&mut self) -> Result<(), StoreError> {
        self.ledger = self.board.read(LEDGER)?.unwrap_or_default();
        if self.is_new {
            let living: Vec<&str> = self.ledger.living().map(|array| array.name.as_str()).collect();
            let is_old = |name: &String| !living.iter().any(|array| name.contains(array));
            let began = self.board.names(BEGAN)?.into_iter().filter(is_old);
            let left = self.board.names(LEFT)?.into_iter().filter(is_old);
            let old: Vec<String> = began.chain(left).chain(self.board.names(FAILED)?).collect();
            old.iter().try_for_each(|name| self.board.remove(name))?;
            self.board.remove(TROUBLE)?;
            self.board.remove(CANCELLED)?;
            self.ledger.recipe = self.submission.recipe.clone();
            self.keep()?;
            self.is_new = false;
        }
        Ok(())
    }

    fn keep(&self) -> Result<(), StoreError> {
        self.board.write(LEDGER, &self.ledger)
    }

    /// What one does who does not lead.
    fn watch(&mut self, stages: &[StageProgress]) -> Result<Option<Ending>, StoreError> {
        let failures = self.failures()?;
        Ok(match () {
            () if all_there(stages) => Some(Ending::Done),
            // Another goes on with it.
            () if self.submission.once || self.submission.cancel.load(Ordering::Relaxed) => {
                let names = self.ledger.living().map(|array| array.name.clone());
                Some(Ending::Left(names.collect()))
            }
            // The other is about to end; then this one begins anew.
            () if self.is_new && is_cancelled(&self.board) => None,
            () if is_cancelled(&self.board) => Some(Ending::Cancelled(None)),
            () if !failures.is_empty() && !self.ledger.recipe.keep_going => Some(Ending::Failed(failures)),
            () => None,
        })
    }

    /// What one does who leads.
    fn act(&mut self, stages: &[StageProgress]) -> Result<Option<Ending>, SubmitError> {
        if all_there(stages) {
            // What still waits has nothing to do; where it cannot be cancelled it ends by itself.
            if self.cancel_all().is_err() {
                self.ledger.arrays.iter_mut().for_each(|array| array.living = 0);
            }
            self.keep()?;
            return Ok(Some(Ending::Done));
        }
        if is_cancelled(&self.board) || self.submission.cancel.load(Ordering::Relaxed) {
            // For those who follow, and workers that nobody can end. Where it cannot be written, workers are ended all the same.
            let noted = self.board.write(CANCELLED, &true);
            let cancelled = self.cancel_all();
            noted?;
            self.keep()?;
            return Ok(Some(Ending::Cancelled(cancelled.err())));
        }
        let failures = self.failures()?;
        if !failures.is_empty() && !self.submission.recipe.keep_going {
            // It has failed, whether what is left can be cancelled or not.
            let _ = self.cancel_all();
            self.keep()?;
            return Ok(Some(Ending::Failed(failures)));
        }
        self.ask(stages)?;
        let failed: BTreeSet<&str> = failures.iter().filter_map(|failed| failed.stage.as_deref()).collect();
        for at in 0..self.groups.len() {
            if let Some(ending) = self.fill(at, stages, &failed)? {
                return Ok(Some(ending));
            }
        }
        let is_idle = self.ledger.living().next().is_none();
        Ok(match () {
            () if is_idle && !failures.is_empty() => Some(Ending::Failed(failures)),
            () if self.submission.once && self.trouble.is_some() => self.trouble.clone().map(Ending::Refused),
            () if self.submission.once && !is_idle => {
                let names = self.ledger.living().map(|array| array.name.clone());
                Some(Ending::Submitted(names.collect()))
            }
            () => None,
        })
    }

    fn cancel_all(&mut self) -> Result<(), EngineError> {
        cancel_arrays(&self.ledger, self.submission.engine)?;
        self.ledger.arrays.iter_mut().for_each(|array| array.living = 0);
        Ok(())
    }

    fn failures(&self) -> Result<Vec<Failed>, StoreError> {
        let names = self.board.names(FAILED)?;
        let failures = names.iter().map(|name| self.board.read(name));
        let failures: Vec<Option<Failed>> = failures.collect::<Result<_, _>>()?;
        Ok(failures.into_iter().flatten().collect())
    }

    /// Asks the engine what waits and works, if it is time to.
    fn ask(&mut self, stages: &[StageProgress]) -> Result<(), StoreError> {
        let is_time = self.asked.is_none_or(|asked| asked.elapsed() >= self.interval);
        if !is_time || self.ledger.living().next().is_none() {
            return Ok(());
        }
        self.asked = Some(Instant::now());
        let names: Vec<&str> = self.ledger.living().map(|array| array.name.as_str()).collect();
        let counts = match self.submission.engine.living(&names) {
            Ok(Some(counts)) => {
                self.trouble = None;
                counts
            }
            Ok(None) => {
                self.trouble = None;
                self.shown()?
            }
            Err(error) => {
                self.trouble = Some(error.to_string());
                self.interval = (2 * self.interval).min(interval().1);
                return Ok(());
            }
        };
        let mut has_changed = false;
        for at in 0..self.ledger.arrays.len() {
            let array = &mut self.ledger.arrays[at];
            let living = counts.get(&array.name).copied().unwrap_or(0);
            if array.living == 0 || array.living == living {
                continue;
            }
            (array.living, has_changed) = (living, true);
            if living == 0 {
                let array = array.clone();
                self.ended(stages, &array)?;
            }
        }
        let (shortest, longest) = interval();
        match has_changed {
            true => {
                self.interval = shortest;
                self.keep()
            }
            false => {
                self.interval = (self.interval * 3 / 2).min(longest);
                Ok(())
            }
        }
    }

    /// Learns from an array of which nobody waits or works any more.
    fn ended(&mut self, stages: &[StageProgress], array: &Array) -> Result<(), StoreError> {
        let has_built = done(stages, &array.stages) > array.before || self.last_checkpoint()? > array.checkpoint;
        // What others build, they build: it is looked for again, and that is no failure.
        let has_left = self.board.has(&format!("{LEFT}{}", array.name));
        let shortest = interval().0;
        for group in self.groups.iter_mut().filter(|group| group.stages == array.stages) {
            group.fruitless = match has_built || has_left {
                true => 0,
                false => group.fruitless + 1,
            };
            let doubled = shortest * 2_u32.saturating_pow(group.fruitless.saturating_sub(1).min(10));
            group.until = match (has_built, group.fruitless) {
                (true, _) => None,
                (false, 0 | 1) if !array.refused && !has_left => None,
                _ => Instant::now().checked_add(doubled.min(BACK_OFF)),
            };
        }
        Ok(())
    }

    /// When a checkpoint was last written in the store, s since 1970; 0 where there is none.
    fn last_checkpoint(&self) -> Result<u64, StoreError> {
        let checkpoints = self.submission.store.checkpoints()?;
        let last = checkpoints.iter().filter_map(|found| found.written).max();
        let since = last.and_then(|last| last.duration_since(SystemTime::UNIX_EPOCH).ok());
        Ok(since.map_or(0, |since| since.as_secs()))
    }

    /// What waits and works as workers show themselves: who has not begun waits.
    fn shown(&mut self) -> Result<BTreeMap<String, u32>, StoreError> {
        let began = self.board.names(BEGAN)?;
        let workers = workers(self.submission.store)?;
        let mut living = BTreeMap::new();
        for array in self.ledger.living() {
            let prefix = format!("{BEGAN}{}-", array.name);
            let begun = began.iter().filter(|name| name.starts_with(&prefix)).count();
            let shown = workers.iter().filter(|seen| seen.silent < SILENT);
            let shown = shown.filter(|seen| seen.worker.array.as_deref() == Some(&array.name));
            let waits = match array.refused {
                true => 0,
                false => usize::try_from(array.workers)
                    .unwrap_or(usize::MAX)
                    .saturating_sub(begun),
            };
            let since = humantime::parse_rfc3339(&array.since).ok();
            let waited = since.and_then(|since| SystemTime::now().duration_since(since).ok());
            if begun == 0 && waited.is_some_and(|waited| waited > WAITING) {
                self.trouble = Some(format!("no worker of {} has started since {}", array.name, array.since));
            }
            living.insert(
                array.name.clone(),
                u32::try_from(waits + shown.count()).unwrap_or(u32::MAX),
            );
        }
        Ok(living)
    }

    /// Starts workers on a group of stages if it has more work than workers.
    fn fill(
        &mut self,
        at: usize,
        stages: &[StageProgress],
        failed: &BTreeSet<&str>,
    ) -> Result<Option<Ending>, StoreError> {
        let group = &self.groups[at];
        let own = stages.iter().filter(|stage| group.stages.contains(&stage.name));
        let ready: u64 = own
            .filter(|stage| !failed.contains(stage.name.as_str()))
            .map(StageProgress::ready)
            .sum();
        let meets = |array: &&Array| array.stages.iter().any(|stage| group.stages.contains(stage));
        let living: u32 = self.ledger.living().filter(meets).map(|array| array.living).sum();
        let wanted = u32::try_from(ready).unwrap_or(u32::MAX).min(group.resources.workers);
        let missing = wanted.saturating_sub(living).min(self.submission.engine.most_workers());
        if missing == 0 || group.until.is_some_and(|until| Instant::now() < until) {
            return Ok(None);
        }
        if group.fruitless > group.resources.retries {
            // Others of the group may bring something about yet.
            if living > 0 {
                return Ok(None);
            }
            let trouble = self.board.read(TROUBLE)?;
            let stages = stages.iter().filter(|stage| stage.readiness == Readiness::Ready);
            let names = stages
                .map(|stage| stage.name.clone())
                .filter(|name| group.stages.contains(name));
            let names = names.collect();
            // It has been given up, whether what is left can be cancelled or not.
            let _ = self.cancel_all();
            self.keep()?;
            return Ok(Some(Ending::GivenUp(names, trouble)));
        }
        self.submit(at, missing, done(stages, &self.groups[at].stages), failed)?;
        Ok(None)
    }

    fn submit(&mut self, at: usize, workers: u32, before: u64, failed: &BTreeSet<&str>) -> Result<(), StoreError> {
        let checkpoint = self.last_checkpoint()?;
        let group = &self.groups[at];
        let array = self
            .ledger
            .begin(&self.topic, group.stages.clone(), workers, (before, checkpoint));
        // Written down before: who takes over a submitter that was killed meanwhile looks for it.
        self.keep()?;
        let group = &self.groups[at];
        // Workers start in folders of their own.
        let logs = self.board.logs()?;
        let logs = std::path::absolute(&logs).unwrap_or(logs).display().to_string();
        // What no worker can build is not tried again.
        let wanted = group.stages.iter().filter(|stage| !failed.contains(stage.as_str()));
        let wanted: Vec<String> = wanted.cloned().collect();
        let are_all = self.groups.len() == 1 && wanted.len() == group.stages.len();
        let names = named(self.submission.pipeline, &wanted, are_all);
        let stages = names.into_iter().flat_map(|name| ["--stage".to_owned(), name]);
        let own = [
            "--topic".to_owned(),
            self.topic.clone(),
            "--array".to_owned(),
            array.name.clone(),
            "--jobs".to_owned(),
            group.resources.threads.to_string(),
        ];
        let own: Vec<String> = stages.chain(own).collect();
        let time = group.resources.time.map(|time| {
            let before = (time / 10).min(Duration::from_secs(300));
            [
                "--time".to_owned(),
                format!("{}s", time.as_secs()),
                "--stop-before".to_owned(),
                format!("{}s", before.as_secs()),
            ]
        });
        let worker = [
            self.submission.worker,
            &own,
            time.as_ref().map_or(&[], |time| &time[..]),
        ]
        .concat();
        let submitted = self.submission.engine.submit(&Request {
            name: &array.name,
            workers,
            resources: &group.resources,
            worker: &worker,
            logs: &logs,
        });
        match submitted {
            Ok(number) => {
                self.trouble = None;
                if let Some(last) = self.ledger.arrays.last_mut() {
                    last.number = number;
                }
            }
            Err(error) => {
                // It may have been started all the same: the engine is asked, and it counts as begun until then.
                self.trouble = Some(error.to_string());
                if let Some(last) = self.ledger.arrays.last_mut() {
                    last.refused = true;
                }
                report_trouble(&self.board, &error.to_string())?;
            }
        }
        // The answer before says nothing of this one.
        self.asked = Some(Instant::now());
        self.keep()
    }
}

/// Stages as a command line names them: a sweep in place of all its stages, and none where they are all there are.
fn named(pipeline: &Pipeline, stages: &[String], are_all: bool) -> Vec<String> {
    if are_all {
        return Vec::new();
    }
    let own: BTreeSet<&String> = stages.iter().collect();
    let whole = |sweep: &&Sweep| sweep.stages.iter().all(|stage| own.contains(stage));
    let sweeps: Vec<&Sweep> = pipeline.sweeps.iter().filter(whole).collect();
    let swept: BTreeSet<&String> = sweeps.iter().flat_map(|sweep| &sweep.stages).collect();
    let alone = stages.iter().filter(|stage| !swept.contains(stage));
    alone.chain(sweeps.iter().map(|sweep| &sweep.name)).cloned().collect()
}

fn all_there(stages: &[StageProgress]) -> bool {
    stages.iter().all(|stage| stage.readiness == Readiness::Built)
}

/// Pieces of some stages that are there. A stage that is put together counts as one more.
fn done(stages: &[StageProgress], names: &[String]) -> u64 {
    let own = stages.iter().filter(|stage| names.contains(&stage.name));
    own.map(|stage| stage.done + u64::from(stage.readiness == Readiness::Built))
        .sum()
}
