//! Keeps as many workers running as there is work, until everything is built.
//!
//! Only the store decides what is built: a stage is built if its record verifies. An engine that does not answer gives
//! no information about its workers.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime};

use super::engine::{EngineError, Request};
use super::ledger::{Array, LEDGER, Ledger};
use super::notes::{self, BEGAN, CANCELLED, FAILED, LEFT, TROUBLE, cancel_arrays, is_cancelled, report_trouble, topic};
use super::profile::Resources;
use super::submission::{Ending, Submission, SubmissionStatus, SubmitError};
use super::workers::{HEARTBEAT_TIMEOUT, workers};
use deaflow_orchestrator::{Pipeline, Readiness, RunError, StageProgress, Sweep, stage_progress};
use deaflow_store::{Board, Guard, StoreError};

/// Shortest time between two steps of the supervisor.
const PAUSE: Duration = Duration::from_millis(500);

/// The pause after a step is at least this many times its duration.
const PAUSE_FACTOR: u32 = 5;

/// Shortest and longest time between two queries of the engine.
const QUERY_INTERVAL: (Duration, Duration) = (Duration::from_secs(10), Duration::from_secs(30));

/// The time after which it is reported that no worker of an array has started.
const QUEUE_WARNING: Duration = Duration::from_secs(600);

/// The longest time before workers are restarted after some that built nothing.
const MAX_BACK_OFF: Duration = Duration::from_secs(600);

/// The number of successive store errors that are tolerated.
const MAX_STORE_ERRORS: u32 = 20;

/// Stages with the same resources, which are built by the same workers.
struct WorkerGroup {
    resources: Resources,
    stages: Vec<String>,
    /// How often in succession its workers built nothing or were refused.
    failed_attempts: u32,
    /// When the next workers may be started.
    until: Option<Instant>,
}

/// Has workers build everything that is missing. Calls `report` at each step.
///
/// # Errors
/// If the pipeline cannot be read, or the store fails repeatedly.
pub fn supervise(submission: &Submission<'_>, report: &dyn Fn(&SubmissionStatus<'_>)) -> Result<Ending, SubmitError> {
    let topic = topic(submission.pipeline, submission.options.until.as_deref());
    let board = submission.store.board(&topic);
    let mut supervisor = Supervisor {
        submission,
        ledger: Ledger::default(),
        groups: groups(submission)?,
        queried: None,
        interval: query_interval().0,
        trouble: None,
        // Work that was cancelled earlier is started again once no other submitter leads.
        is_new: !submission.is_continuation,
        lead: None,
        board,
        topic,
    };
    let mut store_errors = 0;
    loop {
        let start = Instant::now();
        match supervisor.step(report) {
            Ok(Some(ending)) => return Ok(ending),
            Ok(None) => store_errors = 0,
            // A network error or a full disk: the workers continue in the meantime.
            Err(SubmitError::Store(error) | SubmitError::Run(RunError::Store(error)))
                if error.is_transient() && store_errors < MAX_STORE_ERRORS =>
            {
                store_errors += 1;
                supervisor.trouble = Some(error.to_string());
            }
            Err(error) => return Err(error),
        }
        let pause = PAUSE.max(start.elapsed() * PAUSE_FACTOR).max(PAUSE * store_errors);
        let end = Instant::now() + pause;
        while Instant::now() < end && !submission.cancel.load(Ordering::Relaxed) {
            sleep(Duration::from_millis(50).min(pause));
        }
    }
}

/// Returns the shortest and longest interval of queries. `DEAFLOW_ASK_SECONDS` overrides the shortest, for tests.
fn query_interval() -> (Duration, Duration) {
    let seconds = std::env::var("DEAFLOW_ASK_SECONDS").ok();
    let seconds: Option<f64> = seconds.and_then(|seconds| seconds.parse().ok());
    match seconds.filter(|seconds| (0.05..=3600.0).contains(seconds)) {
        None => QUERY_INTERVAL,
        Some(seconds) => (Duration::from_secs_f64(seconds), Duration::from_secs_f64(3.0 * seconds)),
    }
}

fn groups(submission: &Submission<'_>) -> Result<Vec<WorkerGroup>, RunError> {
    let pipeline = submission.pipeline;
    let selection = pipeline.selection(submission.options.until.as_deref())?;
    let mut groups: BTreeMap<Resources, Vec<String>> = BTreeMap::new();
    for spec in selection.into_iter().map(|index| &pipeline.stages[index]) {
        let resources = submission.profile.resources(pipeline, spec);
        groups.entry(resources).or_default().push(spec.name.clone());
    }
    let group = |(resources, stages)| WorkerGroup {
        resources,
        stages,
        failed_attempts: 0,
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
    /// When the engine was last queried.
    queried: Option<Instant>,
    interval: Duration,
    trouble: Option<String>,
    /// Whether it still has to discard the cancellation and the failures of an earlier submission.
    is_new: bool,
    lead: Option<Guard>,
}

impl Supervisor<'_> {
    fn step(&mut self, report: &dyn Fn(&SubmissionStatus<'_>)) -> Result<Option<Ending>, SubmitError> {
        let submission = self.submission;
        // Workers of another user can be neither queried nor cancelled.
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
            submission.options.until.as_deref(),
        )?;
        report(&SubmissionStatus {
            stages: &stages,
            workers: self.ledger.active().map(|array| array.active).sum(),
            trouble: self.trouble.as_deref(),
            follows: self.lead.is_none(),
        });
        match &self.lead {
            Some(_) => self.lead_step(&stages),
            None => Ok(self.follow_step(&stages)?),
        }
    }

    /// Takes over what is already submitted. A new submission discards the failures of an earlier one: those that
    /// persist will be reported again.
    fn take_over(&mut self) -> Result<(), StoreError> {
        self.ledger = self.board.read(LEDGER)?.unwrap_or_default();
        if self.is_new {
            let active: Vec<&str> = self.ledger.active().map(|array| array.name.as_str()).collect();
            let is_old = |name: &String| !active.iter().any(|array| name.contains(array));
            let began = self.board.names(BEGAN)?.into_iter().filter(is_old);
            let left = self.board.names(LEFT)?.into_iter().filter(is_old);
            let old: Vec<String> = began.chain(left).chain(self.board.names(FAILED)?).collect();
            old.iter().try_for_each(|name| self.board.remove(name))?;
            self.board.remove(TROUBLE)?;
            self.board.remove(CANCELLED)?;
            self.ledger.options = self.submission.options.clone();
            self.save()?;
            self.is_new = false;
        }
        Ok(())
    }

    fn save(&self) -> Result<(), StoreError> {
        self.board.write(LEDGER, &self.ledger)
    }

    fn active_names(&self) -> Vec<String> {
        self.ledger.active().map(|array| array.name.clone()).collect()
    }

    /// The step of a submitter that follows another.
    fn follow_step(&mut self, stages: &[StageProgress]) -> Result<Option<Ending>, StoreError> {
        let failures = notes::failures(&self.board)?;
        Ok(match () {
            () if all_built(stages) => Some(Ending::Done),
            // The other submitter continues.
            () if self.submission.once || self.submission.cancel.load(Ordering::Relaxed) => {
                Some(Ending::Left(self.active_names()))
            }
            // The other submitter is about to end; then this one starts again.
            () if self.is_new && is_cancelled(&self.board) => None,
            () if is_cancelled(&self.board) => Some(Ending::Cancelled(None)),
            () if !failures.is_empty() && !self.ledger.options.keep_going => Some(Ending::Failed(failures)),
            () => None,
        })
    }

    /// The step of the leading submitter.
    fn lead_step(&mut self, stages: &[StageProgress]) -> Result<Option<Ending>, SubmitError> {
        if all_built(stages) {
            // Queued workers have nothing to do; those that cannot be cancelled end by themselves.
            if self.cancel_all().is_err() {
                self.ledger.end_all();
            }
            self.save()?;
            return Ok(Some(Ending::Done));
        }
        if is_cancelled(&self.board) || self.submission.cancel.load(Ordering::Relaxed) {
            // The note is for followers and for workers that the engine cannot cancel. If it cannot be written, the
            // workers are cancelled anyway.
            let noted = self.board.write(CANCELLED, &true);
            let cancelled = self.cancel_all();
            noted?;
            self.save()?;
            return Ok(Some(Ending::Cancelled(cancelled.err())));
        }
        let failures = notes::failures(&self.board)?;
        if !failures.is_empty() && !self.submission.options.keep_going {
            // It has failed, whether the other workers can be cancelled or not.
            let _ = self.cancel_all();
            self.save()?;
            return Ok(Some(Ending::Failed(failures)));
        }
        self.query_engine(stages)?;
        let failed: BTreeSet<&str> = failures.iter().filter_map(|failed| failed.stage.as_deref()).collect();
        for at in 0..self.groups.len() {
            if let Some(ending) = self.fill(at, stages, &failed)? {
                return Ok(Some(ending));
            }
        }
        let is_idle = self.ledger.active().next().is_none();
        Ok(match () {
            () if is_idle && !failures.is_empty() => Some(Ending::Failed(failures)),
            () if self.submission.once && self.trouble.is_some() => self.trouble.clone().map(Ending::Refused),
            () if self.submission.once && !is_idle => Some(Ending::Submitted(self.active_names())),
            () => None,
        })
    }

    fn cancel_all(&mut self) -> Result<(), EngineError> {
        cancel_arrays(&self.ledger, self.submission.engine)?;
        self.ledger.end_all();
        Ok(())
    }

    /// Queries the engine for queued and running workers, if it is time.
    fn query_engine(&mut self, stages: &[StageProgress]) -> Result<(), StoreError> {
        let is_time = self.queried.is_none_or(|queried| queried.elapsed() >= self.interval);
        if !is_time || self.ledger.active().next().is_none() {
            return Ok(());
        }
        self.queried = Some(Instant::now());
        let names: Vec<&str> = self.ledger.active().map(|array| array.name.as_str()).collect();
        let counts = match self.submission.engine.active_workers(&names) {
            Ok(Some(counts)) => {
                self.trouble = None;
                counts
            }
            Ok(None) => {
                self.trouble = None;
                self.count_workers()?
            }
            Err(error) => {
                self.trouble = Some(error.to_string());
                self.interval = (2 * self.interval).min(query_interval().1);
                return Ok(());
            }
        };
        let mut has_changed = false;
        for at in 0..self.ledger.arrays.len() {
            let array = &mut self.ledger.arrays[at];
            let active = counts.get(&array.name).copied().unwrap_or(0);
            if array.active == 0 || array.active == active {
                continue;
            }
            (array.active, has_changed) = (active, true);
            if active == 0 {
                let array = array.clone();
                self.ended(stages, &array)?;
            }
        }
        let (shortest, longest) = query_interval();
        match has_changed {
            true => {
                self.interval = shortest;
                self.save()
            }
            false => {
                self.interval = (self.interval * 3 / 2).min(longest);
                Ok(())
            }
        }
    }

    /// Decides when to start workers again after all of an array have ended.
    fn ended(&mut self, stages: &[StageProgress], array: &Array) -> Result<(), StoreError> {
        let has_built = done(stages, &array.stages) > array.before || self.last_checkpoint()? > array.checkpoint;
        // If others are building its stages, that it built nothing is no failure.
        let has_left = self.board.has(&format!("{LEFT}{}", array.name));
        let shortest = query_interval().0;
        for group in self.groups.iter_mut().filter(|group| group.stages == array.stages) {
            group.failed_attempts = match has_built || has_left {
                true => 0,
                false => group.failed_attempts + 1,
            };
            let doubled = shortest * 2_u32.saturating_pow(group.failed_attempts.saturating_sub(1).min(10));
            group.until = match (has_built, group.failed_attempts) {
                (true, _) => None,
                (false, 0 | 1) if !array.refused && !has_left => None,
                _ => Instant::now().checked_add(doubled.min(MAX_BACK_OFF)),
            };
        }
        Ok(())
    }

    /// Returns when the last checkpoint was written in the store, in s since 1970; 0 if there is none.
    fn last_checkpoint(&self) -> Result<u64, StoreError> {
        let checkpoints = self.submission.store.checkpoints()?;
        let last = checkpoints.iter().filter_map(|found| found.written).max();
        let since = last.and_then(|last| last.duration_since(SystemTime::UNIX_EPOCH).ok());
        Ok(since.map_or(0, |since| since.as_secs()))
    }

    /// Counts the workers of each array by their notes in the store; those that have not started count as queued.
    fn count_workers(&mut self) -> Result<BTreeMap<String, u32>, StoreError> {
        let began = self.board.names(BEGAN)?;
        let workers = workers(self.submission.store)?;
        let mut active = BTreeMap::new();
        for array in self.ledger.active() {
            let prefix = format!("{BEGAN}{}-", array.name);
            let begun = began.iter().filter(|name| name.starts_with(&prefix)).count();
            let running = workers.iter().filter(|seen| seen.silent < HEARTBEAT_TIMEOUT);
            let running = running.filter(|seen| seen.worker.array.as_deref() == Some(&array.name));
            let queued = match array.refused {
                true => 0,
                false => usize::try_from(array.workers)
                    .unwrap_or(usize::MAX)
                    .saturating_sub(begun),
            };
            let since = humantime::parse_rfc3339(&array.since).ok();
            let waited = since.and_then(|since| SystemTime::now().duration_since(since).ok());
            if begun == 0 && waited.is_some_and(|waited| waited > QUEUE_WARNING) {
                self.trouble = Some(format!("no worker of {} has started since {}", array.name, array.since));
            }
            active.insert(
                array.name.clone(),
                u32::try_from(queued + running.count()).unwrap_or(u32::MAX),
            );
        }
        Ok(active)
    }

    /// Starts workers for a group of stages if it has more work than workers.
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
        let shares_stages = |array: &&Array| array.stages.iter().any(|stage| group.stages.contains(stage));
        let active: u32 = self
            .ledger
            .active()
            .filter(shares_stages)
            .map(|array| array.active)
            .sum();
        let needed = u32::try_from(ready).unwrap_or(u32::MAX).min(group.resources.workers);
        let missing = needed.saturating_sub(active).min(self.submission.engine.most_workers());
        if missing == 0 || group.until.is_some_and(|until| Instant::now() < until) {
            return Ok(None);
        }
        if group.failed_attempts > group.resources.retries {
            // Other workers of the group may still build something.
            if active > 0 {
                return Ok(None);
            }
            let trouble = self.board.read(TROUBLE)?;
            let stages = stages.iter().filter(|stage| stage.readiness == Readiness::Ready);
            let names = stages
                .map(|stage| stage.name.clone())
                .filter(|name| group.stages.contains(name));
            let names = names.collect();
            // It is given up, whether the other workers can be cancelled or not.
            let _ = self.cancel_all();
            self.save()?;
            return Ok(Some(Ending::GivenUp(names, trouble)));
        }
        self.submit(at, missing, done(stages, &self.groups[at].stages), failed)?;
        Ok(None)
    }

    fn submit(&mut self, at: usize, workers: u32, before: u64, failed: &BTreeSet<&str>) -> Result<(), StoreError> {
        let checkpoint = self.last_checkpoint()?;
        let stages = self.groups[at].stages.clone();
        let array = self.ledger.add(&self.topic, stages, workers, (before, checkpoint));
        // The ledger is saved first, so that the successor of a killed submitter looks for the array.
        self.save()?;
        // Workers start in other folders, so the path must be absolute.
        let logs = self.board.logs()?;
        let logs = std::path::absolute(&logs).unwrap_or(logs).display().to_string();
        let group = &self.groups[at];
        let worker = self.worker_command(group, &array.name, failed);
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
                // The engine may have started it anyway: it counts as running until the next query.
                self.trouble = Some(error.to_string());
                if let Some(last) = self.ledger.arrays.last_mut() {
                    last.refused = true;
                }
                report_trouble(&self.board, &error.to_string())?;
            }
        }
        // The last query did not cover this array.
        self.queried = Some(Instant::now());
        self.save()
    }

    /// Returns the command line of the workers of a group. Stages that have failed are not tried again.
    fn worker_command(&self, group: &WorkerGroup, array: &str, failed: &BTreeSet<&str>) -> Vec<String> {
        let stages = group.stages.iter().filter(|stage| !failed.contains(stage.as_str()));
        let stages: Vec<String> = stages.cloned().collect();
        let are_all = self.groups.len() == 1 && stages.len() == group.stages.len();
        let mut command = self.submission.worker.to_vec();
        for name in named(self.submission.pipeline, &stages, are_all) {
            command.extend(["--stage".to_owned(), name]);
        }
        let threads = group.resources.threads.to_string();
        command.extend(["--topic", &self.topic, "--array", array, "--jobs", &threads].map(str::to_owned));
        if let Some(time) = group.resources.time {
            let before = (time / 10).min(Duration::from_secs(300));
            let [time, before] = [time, before].map(|time| format!("{}s", time.as_secs()));
            command.extend(["--time".to_owned(), time, "--stop-before".to_owned(), before]);
        }
        command
    }
}

/// Returns the stages as a command line names them: a sweep instead of all its stages, and none if they are all stages
/// of the pipeline.
fn named(pipeline: &Pipeline, stages: &[String], are_all: bool) -> Vec<String> {
    if are_all {
        return Vec::new();
    }
    let own: BTreeSet<&String> = stages.iter().collect();
    let is_complete = |sweep: &&Sweep| sweep.stages.iter().all(|stage| own.contains(stage));
    let sweeps: Vec<&Sweep> = pipeline.sweeps.iter().filter(is_complete).collect();
    let swept: BTreeSet<&String> = sweeps.iter().flat_map(|sweep| &sweep.stages).collect();
    let others = stages.iter().filter(|stage| !swept.contains(stage));
    others.chain(sweeps.iter().map(|sweep| &sweep.name)).cloned().collect()
}

fn all_built(stages: &[StageProgress]) -> bool {
    stages.iter().all(|stage| stage.readiness == Readiness::Built)
}

/// Returns the number of finished pieces of some stages. A finished stage counts as one more.
fn done(stages: &[StageProgress], names: &[String]) -> u64 {
    let own = stages.iter().filter(|stage| names.contains(&stage.name));
    own.map(|stage| stage.done + u64::from(stage.readiness == Readiness::Built))
        .sum()
}
