//! Runs a pipeline: whatever is ready, in topological order, building what is stale and no more.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::channel;
use std::time::{Duration, SystemTime};

use super::build::Builder;
use super::cost_estimate;
use super::event::{Event, Listener, Outcome, StageReport};
use super::kind::{Input, Plan, StageError};
use super::lock_difference::LockDifference;
use super::locked;
use super::plan;
use super::plan_warnings::plan_warnings;
use super::planner::{self, Planner, StageStatus, State};
use super::price::{Price, PriceTotal};
use super::provenance::Environment;
use super::shares::Shares;
use super::spec::{Pipeline, StageSpec};
use super::staleness::Staleness;
use super::work::{Built, Work};
use deaflow_base::{ArtifactId, InputError};
use deaflow_store::{Command, Effort, LockFile, LockedStage, Record, Run, RunStage, StageOutcome, Store, StoreError};

/// Stack of the thread of a stage, bytes: as much as the main thread has.
const STACK: usize = 8 << 20;

/// How to run.
#[derive(Clone, Copy, Debug, Default)]
pub struct RunOptions<'a> {
    /// The last stage, with all that it needs; or everything.
    pub until: Option<&'a str>,
    /// Whether to build that stage alone, from what is there: stages before it are left as they are, missing or not.
    pub only: bool,
    /// By which the history knows it.
    pub command: Command,
    /// Whether to build all that can be built although something failed.
    pub keep_going: bool,
    /// What every stage must be and make.
    pub lock: Option<&'a LockFile>,
    /// Where the listener writes what is built, in the folder of the store.
    pub log: Option<&'a str>,
    /// How many stages that do not need each other may be built at once; 0 is as 1.
    pub parallel_stages: usize,
    /// Builds these chunks of the last stage and no others; the stage itself is left to whoever builds the rest.
    pub chunks: Option<(usize, usize)>,
    /// Builds these stages and leaves all others to others; or all.
    pub stages: Option<&'a BTreeSet<usize>>,
    /// How long what another process is building is waited for before it is left to that; for ever without.
    pub patience: Option<Duration>,
    /// Once it is set nothing more is begun, and what can be gone on with later stops.
    pub stop: Option<&'a AtomicBool>,
    /// Whether the history is not to know of it.
    pub skip_history: bool,
}

/// Why a run or a plan could not be made.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The stage to stop at does not exist.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The store refused, apart from any stage.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The pipeline is not what its lock file says.
    #[error("the pipeline is not what its lock file says: {}", listed(.0))]
    Locked(Vec<LockDifference>),
}

fn listed(differences: &[LockDifference]) -> String {
    let texts: Vec<String> = differences.iter().map(ToString::to_string).collect();
    texts.join("; ")
}

/// A stage that could not be built.
#[derive(Debug)]
pub struct Failure {
    /// The stage.
    pub stage: String,
    /// Why.
    pub error: StageError,
}

impl Failure {
    /// Whether the stage was asked to stop, and nothing is wrong.
    #[must_use]
    pub fn is_stop(&self) -> bool {
        matches!(self.error, StageError::Stopped(_))
    }
}

/// What a run has done.
#[derive(Debug)]
pub struct RunOutcome {
    /// The stages that were reached, in topological order.
    pub stages: Vec<StageReport>,
    /// How many samples, over all stages, have no stable solution.
    pub unstable: u64,
    /// The stages that failed: one, or with `keep_going` perhaps more.
    pub failures: Vec<Failure>,
    /// Why the run is not remembered, if it is not (a read-only or full store): its results are none the worse.
    pub history_error: Option<StoreError>,
    /// What the stages made, to be held to later.
    pub lock: LockFile,
    /// Warnings that were given before the work.
    pub warnings: Vec<String>,
    /// What it took from its beginning to its end, as the history has it, s.
    pub seconds: f64,
}

/// Runs a pipeline. A stage that fails ends the run, or with `keep_going` only what needs it; what was built stays.
///
/// # Errors
/// When there is no stage of the name to stop at, the pipeline is not what its lock file says, or the store cannot be read or
/// written; a stage's own failure is in the outcome.
pub fn run(
    pipeline: &Pipeline,
    store: &Store,
    options: &RunOptions<'_>,
    environment: &Environment,
    listener: Listener<'_>,
) -> Result<RunOutcome, RunError> {
    let began = (environment.clock)();
    let selection = pipeline.selection(options.until)?;
    if let Some(lock) = options.lock {
        check_locked(pipeline, options.until, store, lock)?;
    }
    let planner = Planner::beside_others(pipeline, store);
    let statuses = planner.statuses(&selection)?;
    let prices = cost_estimate::prices(pipeline, &selection, &statuses, store, environment)?;
    let prices: Vec<Option<Price>> = prices.into_iter().map(|(price, _)| price).collect();
    listener(&started(pipeline, &statuses, &prices));
    let warnings = match options.chunks.is_none() && options.stages.is_none() {
        true => plan_warnings(pipeline, &reports(pipeline, &selection, &statuses), store)?,
        // A part of the work of others, to whom it has been said.
        false => Vec::new(),
    };
    warnings
        .iter()
        .for_each(|text| listener(&Event::Warning { text: text.clone() }));
    let first = if options.only {
        selection.len().saturating_sub(1)
    } else {
        0
    };
    let before = || selection.iter().zip(&statuses).take(first);
    let known = before().map(|(&index, status)| (index, status.as_input())).collect();
    let remembered = before()
        .filter_map(|(&index, status)| Some((index, remembered(&pipeline.stages[index], status)?)))
        .collect();
    let sizes = before().filter_map(|(&index, status)| match &status.state {
        State::Fresh { size, .. } => Some((index, *size)),
        State::Stale { .. } => None,
    });
    let sizes = sizes.collect();
    let builder = Builder {
        store,
        environment,
        listener,
        keep_going: options.keep_going,
        stop: options.stop,
        only: options.chunks.and_then(|chunks| Some((*selection.last()?, chunks))),
        patience: options.patience,
    };
    let mut execution = Execution {
        pipeline,
        read_closely: read_closely(pipeline, &selection, &statuses),
        // Where nothing is stale nothing that happens can change what was found: a rerun looks once.
        known_statuses: match statuses.iter().any(StageStatus::is_stale) {
            true => BTreeMap::new(),
            false => selection.iter().copied().zip(statuses).collect(),
        },
        planner,
        builder: &builder,
        parallel_stages: options.parallel_stages.max(1),
        ours: options.stages,
        lock: options.lock,
        prices: selection.iter().copied().zip(prices).collect(),
        inputs: known,
        sizes,
        remembered,
        history_error: None,
        unstable: BTreeMap::new(),
    };
    let (stages, failures) = execution.stages(selection.get(first..).unwrap_or_default());
    let lock = execution.lock_file();
    store.save_index();
    let stages_done = std::mem::take(&mut execution.remembered);
    let is_whole = options.chunks.is_none() && options.stages.is_none();
    let is_left = |index: &&usize| is_whole && !stages_done.contains_key(index);
    let left = selection
        .iter()
        .filter(is_left)
        .map(|&index| &pipeline.stages[index].name);
    let has_ended = |name: &&String| !failures.iter().any(|failure| failure.stage == **name);
    let not_begun = left.filter(has_ended).cloned().collect();
    let seconds = environment.seconds_since(began);
    let run = Run {
        command: options.command,
        seconds,
        log: options.log.filter(|_| stages.iter().any(is_work)).map(str::to_owned),
        stages: stages_done.into_values().collect(),
        failures: named(&failures, |failure| !failure.is_stop()),
        stopped: named(&failures, Failure::is_stop),
        not_begun,
        ..Run::default()
    };
    let logged = match options.skip_history {
        true => Ok(()),
        false => execution.log(run),
    };
    let history_error = execution.history_error.or(logged.err());
    if let Some(reason) = &history_error {
        let text = format!("the store does not remember this run: {reason}");
        listener(&Event::Warning { text });
    }
    Ok(RunOutcome {
        stages,
        unstable: execution.unstable.values().sum(),
        failures,
        history_error,
        lock,
        warnings,
        seconds,
    })
}

/// Holds a pipeline to its lock file as far as that can be done before any work.
///
/// # Errors
/// When there is a difference, no stage of the name to stop at, or the store cannot be read.
pub fn check_locked(pipeline: &Pipeline, until: Option<&str>, store: &Store, lock: &LockFile) -> Result<(), RunError> {
    let differences = locked::differences(pipeline, &pipeline.selection(until)?, store, lock)?;
    match differences.is_empty() {
        true => Ok(()),
        false => Err(RunError::Locked(differences)),
    }
}

/// Names of the stages of some failures.
fn named(failures: &[Failure], which: impl Fn(&Failure) -> bool) -> Vec<String> {
    let chosen = failures.iter().filter(|failure| which(failure));
    chosen.map(|failure| failure.stage.clone()).collect()
}

/// Whether anything was done for a stage.
fn is_work(report: &StageReport) -> bool {
    matches!(report.outcome, Outcome::Built | Outcome::Failed | Outcome::Stopped)
}

/// A stage that is there and is not looked at any more.
fn remembered(spec: &StageSpec, status: &StageStatus) -> Option<RunStage> {
    match &status.state {
        State::Fresh { record, .. } => Some(RunStage {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            key: record.key,
            artifact: record.artifact,
            outcome: StageOutcome::Reused,
        }),
        State::Stale { .. } => None,
    }
}

fn started(pipeline: &Pipeline, statuses: &[StageStatus], prices: &[Option<Price>]) -> Event {
    let stale = statuses.iter().zip(prices).filter(|(status, _)| status.is_stale());
    let total = PriceTotal::of(stale.map(|(_, price)| *price));
    Event::RunStarted {
        pipeline: pipeline.name.clone(),
        stages: statuses.len(),
        stale: total.stale,
        price: total.price,
        unpriced: total.unpriced,
    }
}

/// What is known of each stage before the work.
fn reports(pipeline: &Pipeline, selection: &[usize], statuses: &[StageStatus]) -> Vec<StageReport> {
    let each = selection.iter().zip(statuses);
    each.map(|(&index, status)| plan::report(&pipeline.stages[index], status))
        .collect()
}

/// The stages whose artifacts are going to be read. They are verified in full beforehand, so that damage is found while
/// they can still be rebuilt, and not by the stage that reads them.
fn read_closely(pipeline: &Pipeline, selection: &[usize], statuses: &[StageStatus]) -> BTreeSet<usize> {
    let stale = selection.iter().zip(statuses).filter(|(_, status)| status.is_stale());
    stale
        .flat_map(|(&index, _)| pipeline.stages[index].needs.iter().copied())
        .collect()
}

struct Execution<'a> {
    pipeline: &'a Pipeline,
    planner: Planner<'a>,
    builder: &'a Builder<'a>,
    parallel_stages: usize,
    /// The stages that are built here; or all.
    ours: Option<&'a BTreeSet<usize>>,
    lock: Option<&'a LockFile>,
    read_closely: BTreeSet<usize>,
    known_statuses: BTreeMap<usize, StageStatus>,
    prices: BTreeMap<usize, Option<Price>>,
    inputs: BTreeMap<usize, Input>,
    sizes: BTreeMap<usize, u64>,
    /// By their places in the pipeline.
    remembered: BTreeMap<usize, RunStage>,
    history_error: Option<StoreError>,
    /// Samples without a stable solution, by stages.
    unstable: BTreeMap<usize, u64>,
}

/// What has become of the stages so far, by their places in the pipeline.
#[derive(Default)]
struct Concluded {
    reports: BTreeMap<usize, StageReport>,
    failures: BTreeMap<usize, Failure>,
}

/// A stage that is looked at.
enum Begun {
    /// It is there.
    There(Box<StageReport>),
    /// It is being built.
    AtWork(Box<Work>),
    /// It is left to others.
    Others,
    /// Another process builds it.
    Busy,
    /// It has to be built, and these that it needs as well: they were elsewhere, and cannot be had.
    After(Vec<usize>),
}

/// The stages that are not done and not at work.
struct Open {
    /// Those that may be begun.
    left: BTreeSet<usize>,
    /// Those that others build, and that are waited for once there is nothing else to do.
    busy: BTreeSet<usize>,
    /// Those that are left to others.
    others: BTreeSet<usize>,
    /// Whether there is nothing else to do.
    is_patient: bool,
}

impl Open {
    fn contains(&self, index: usize) -> bool {
        [&self.left, &self.busy, &self.others]
            .iter()
            .any(|stages| stages.contains(&index))
    }

    /// Where something has been built here, others have had time to build too.
    fn ended(&mut self, index: usize, report: &Result<StageReport, StageError>) {
        match report.as_ref().map(|report| report.outcome) {
            Ok(Outcome::Left) if self.is_patient => {
                self.others.insert(index);
            }
            Ok(Outcome::Left) => {
                self.busy.insert(index);
            }
            Ok(Outcome::Built) => {
                self.left.append(&mut self.busy);
                self.left.append(&mut self.others);
                self.is_patient = false;
            }
            _ => {}
        }
    }
}

impl<'a> Execution<'a> {
    /// Builds whatever is ready, as many stages at once as are allowed, until one fails, or until all that can be built is there.
    fn stages(&mut self, selection: &[usize]) -> (Vec<StageReport>, Vec<Failure>) {
        let (builder, stages) = (self.builder, &self.pipeline.stages);
        let mut concluded = Concluded::default();
        let mut open = Open {
            left: selection.iter().copied().collect(),
            busy: BTreeSet::new(),
            others: BTreeSet::new(),
            is_patient: false,
        };
        let mut at_work = Shares::default();
        let (sender, receiver) = channel();
        std::thread::scope(|scope| {
            loop {
                while at_work.len() < self.parallel_stages && self.goes_on(&concluded) {
                    let is_open = |index: &usize| open.contains(*index) || at_work.contains(*index);
                    let is_ready = |index: &&usize| !stages[**index].waits_for().iter().any(is_open);
                    let Some(index) = open.left.iter().find(is_ready).copied() else {
                        if open.busy.is_empty() {
                            break;
                        }
                        open.left.append(&mut open.busy);
                        open.is_patient = true;
                        continue;
                    };
                    open.left.remove(&index);
                    if let Some(skipped) = self.skipped(index, &concluded.reports) {
                        concluded.reports.insert(index, skipped);
                        continue;
                    }
                    let start = (builder.environment.clock)();
                    let report = match self.begin(index, start, open.is_patient) {
                        Ok(Begun::Others) => {
                            open.others.insert(index);
                            continue;
                        }
                        Ok(Begun::Busy) => {
                            open.busy.insert(index);
                            continue;
                        }
                        Ok(Begun::After(lost)) => {
                            // What was made from them is looked at again, too: it may be made otherwise.
                            for again in self.with_dependants(lost) {
                                if concluded.reports.remove(&again).is_some() {
                                    self.inputs.remove(&again);
                                    self.unstable.remove(&again);
                                    self.remembered.remove(&again);
                                    open.left.insert(again);
                                }
                            }
                            open.left.insert(index);
                            continue;
                        }
                        Ok(Begun::There(report)) => Ok(*report),
                        Ok(Begun::AtWork(work)) if self.parallel_stages == 1 => {
                            self.end(work.done(builder, &stages[index]), None)
                        }
                        Ok(Begun::AtWork(work)) => {
                            at_work.begin(index, builder.environment);
                            let sender = sender.clone();
                            let build = move || {
                                // Whoever waits would wait for ever for a thread that has panicked.
                                let done = catch_unwind(AssertUnwindSafe(|| work.done(builder, &stages[index])));
                                // Nobody listens any more where another has panicked.
                                let _ = sender.send(done);
                            };
                            let thread = std::thread::Builder::new()
                                .name(stages[index].name.clone())
                                .stack_size(STACK);
                            match thread.spawn_scoped(scope, build) {
                                Ok(_) => continue,
                                Err(error) => {
                                    at_work.end(index, builder.environment);
                                    Err(StageError::failed(format!("cannot start a thread: {error}")))
                                }
                            }
                        }
                        Err(error) => Err(error),
                    };
                    open.ended(index, &report);
                    self.conclude(index, start, report, &mut concluded);
                }
                if at_work.len() == 0 {
                    break;
                }
                // A sender is held here, so there is always one to receive from.
                let Ok(done) = receiver.recv() else { break };
                let done = done.unwrap_or_else(|panic| resume_unwind(panic));
                let (index, start) = (done.work.index, done.work.start);
                let share = at_work.end(index, builder.environment);
                let report = self.end(done, Some(share));
                open.ended(index, &report);
                let has_failed = report
                    .as_ref()
                    .is_err_and(|error| !matches!(error, StageError::Stopped(_)));
                self.conclude(index, start, report, &mut concluded);
                if has_failed && !builder.keep_going {
                    self.tell_of_the_rest(index, &at_work);
                }
            }
        });
        let has_failed = concluded.failures.values().any(|failure| !failure.is_stop());
        if self.ours.is_none() && builder.only.is_none() && has_failed {
            self.list_what_was_not_begun(selection, &mut concluded);
        }
        let Concluded { reports, failures } = concluded;
        (reports.into_values().collect(), failures.into_values().collect())
    }

    /// Lists the stages that were not begun: because one that they need, directly or not, failed, or because the run ended with the failure
    /// of another.
    fn list_what_was_not_begun(&self, selection: &[usize], concluded: &mut Concluded) {
        let failed = concluded.failures.values().find(|failure| !failure.is_stop());
        let first = failed.map_or_else(String::new, |failure| failure.stage.clone());
        for &index in selection {
            if concluded.reports.contains_key(&index) {
                continue;
            }
            let waits_for = self.pipeline.stages[index].waits_for();
            let is_missing = |need: &&usize| {
                let is_skipped = |report: &StageReport| report.outcome == Outcome::Skipped;
                concluded.failures.contains_key(need) || concluded.reports.get(need).is_some_and(is_skipped)
            };
            let report = match waits_for.iter().find(is_missing) {
                Some(missing) => self.skip(index, *missing, &concluded.reports),
                None => StageReport {
                    why: Some(format!(
                        "the run ended with the failure of `{first}` before it was begun"
                    )),
                    ..self.unbuilt(index)
                },
            };
            concluded.reports.insert(index, report);
        }
    }

    /// Says which stages are built to their end although one has failed.
    fn tell_of_the_rest(&self, failed: usize, at_work: &Shares) {
        let stages = &self.pipeline.stages;
        let names: Vec<&str> = at_work.stages().map(|index| stages[index].name.as_str()).collect();
        if !names.is_empty() {
            let text = format!(
                "`{}` failed; {} at work beside it and built to the end, then the run ends: Ctrl-C stops it now",
                stages[failed].name,
                match names.as_slice() {
                    [one] => format!("`{one}` is"),
                    _ => format!("{} are", names.join(", ")),
                }
            );
            (self.builder.listener)(&Event::Warning { text });
        }
    }

    /// Whether more may be begun.
    fn goes_on(&self, concluded: &Concluded) -> bool {
        !self.builder.is_stopped() && (concluded.failures.is_empty() || self.builder.keep_going)
    }

    /// Looks at a stage whose needs are all there. `waits`: whether it is begun although another process builds it.
    fn begin(&mut self, index: usize, start: SystemTime, waits: bool) -> Result<Begun, StageError> {
        let spec = &self.pipeline.stages[index];
        let status = match self.known_statuses.remove(&index) {
            Some(status) => status,
            None => {
                let closely = self.read_closely.contains(&index);
                let effort = if closely { Effort::Thorough } else { Effort::Quick };
                self.planner.status(index, &self.inputs_of(index), effort)?
            }
        };
        let report = plan::report(spec, &status);
        match &status.state {
            State::Fresh { record, .. } => {
                let (record, known) = ((**record).clone(), status.as_input());
                let report = self.take(index, start, report, &record, known)?;
                Ok(Begun::There(Box::new(report)))
            }
            State::Stale { .. } if self.ours.is_some_and(|ours| !ours.contains(&index)) => Ok(Begun::Others),
            State::Stale { .. } if !waits && self.is_busy(&status)? => Ok(Begun::Busy),
            State::Stale { why, .. } => {
                let lost = self.lost(index)?;
                if !lost.is_empty() {
                    return Ok(Begun::After(lost));
                }
                self.announce(index, &status, why);
                Ok(Begun::AtWork(Box::new(Work {
                    index,
                    start,
                    waits,
                    status,
                    report,
                })))
            }
        }
    }

    /// What is known of the stages that a stage needs.
    fn inputs_of(&self, index: usize) -> Vec<Input> {
        let needs = self.pipeline.stages[index].needs.iter();
        needs.filter_map(|need| self.inputs.get(need).cloned()).collect()
    }

    /// Stages, and those that need them, directly or not.
    fn with_dependants(&self, stages: Vec<usize>) -> BTreeSet<usize> {
        let mut found: BTreeSet<usize> = stages.into_iter().collect();
        // They stand in topological order.
        for (index, stage) in self.pipeline.stages.iter().enumerate() {
            if stage.waits_for().iter().any(|need| found.contains(need)) {
                found.insert(index);
            }
        }
        found
    }

    /// What a stage that was not expected to be built needs and what is not here: it is brought, or has to be built first.
    fn lost(&mut self, index: usize) -> Result<Vec<usize>, StoreError> {
        let mut lost = Vec::new();
        if !self.builder.store.has_upstream() {
            return Ok(lost);
        }
        for &need in &self.pipeline.stages[index].needs {
            if !self.read_closely.insert(need) {
                continue;
            }
            if self
                .planner
                .status(need, &self.inputs_of(need), Effort::Thorough)?
                .is_stale()
            {
                lost.push(need);
            }
        }
        Ok(lost)
    }

    /// Whether another process builds a stage that is one piece of work.
    fn is_busy(&self, status: &StageStatus) -> Result<bool, StoreError> {
        match (&status.work, &status.action) {
            (Plan::Whole { .. }, Some((_, key))) => self.builder.store.is_busy(key),
            _ => Ok(false),
        }
    }

    /// Takes over what has been built. `share` is its part of the time of the run, where others may have been built beside it, s.
    fn end(&mut self, done: Built, share: Option<f64>) -> Result<StageReport, StageError> {
        let Built { work, made, waited } = done;
        let Work {
            index,
            start,
            status,
            mut report,
            ..
        } = *work;
        let made = made?;
        made.tell(&mut report);
        report.part = share;
        let spec = &self.pipeline.stages[index];
        let Some(record) = made.record else {
            // Its other chunks are left to others.
            report.seconds = self.builder.environment.seconds_since(start);
            (self.builder.listener)(&Event::StageFinished(report.clone()));
            return Ok(report);
        };
        let known = planner::known(&status.work, Some(record.artifact), &made.parts);
        let report = self.take(index, start, report, &record, known)?;
        if !made.is_sized {
            self.sizes.remove(&index);
        }
        if report.outcome == Outcome::Built && !waited {
            self.remember_cost(spec, &status, &report, record.unstable);
        }
        Ok(report)
    }

    /// Lets later stages know of a stage that is there.
    fn take(
        &mut self,
        index: usize,
        start: SystemTime,
        mut report: StageReport,
        record: &Record,
        known: Input,
    ) -> Result<StageReport, StageError> {
        let spec = &self.pipeline.stages[index];
        report.digest = Some(record.artifact);
        report.seconds = self.builder.environment.seconds_since(start);
        report.price = self.prices.get(&index).copied().flatten();
        if let Some(difference) = self.lock.and_then(|lock| locked::other_artifact(spec, lock, record)) {
            return Err(difference.into());
        }
        self.inputs.insert(index, known);
        self.sizes.insert(index, report.size);
        self.unstable.insert(index, record.unstable);
        (self.builder.listener)(&match report.outcome {
            Outcome::Reused => Event::StageReused(report.clone()),
            _ => Event::StageFinished(report.clone()),
        });
        let ended = match report.outcome {
            Outcome::Built => StageOutcome::Built,
            _ => StageOutcome::Reused,
        };
        let stage = RunStage {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            key: record.key,
            artifact: record.artifact,
            outcome: ended,
        };
        self.remembered.insert(index, stage);
        Ok(report)
    }

    fn conclude(
        &mut self,
        index: usize,
        start: SystemTime,
        report: Result<StageReport, StageError>,
        concluded: &mut Concluded,
    ) {
        let (report, error) = match report {
            Ok(report) => {
                let blocked = self.blocked(index, &report);
                (report, blocked)
            }
            Err(error) => (self.failed(index, start, &error), Some(error)),
        };
        concluded.reports.insert(index, report);
        if let Some(error) = error {
            // It may be there, as an audit that stops what follows is: for what follows it is not.
            self.inputs.remove(&index);
            let stage = self.pipeline.stages[index].name.clone();
            concluded.failures.insert(index, Failure { stage, error });
        }
    }

    /// Remembers what has been run, where that is news.
    fn log(&self, run: Run) -> Result<(), StoreError> {
        let environment = self.builder.environment;
        let run = Run {
            pipeline: self.pipeline.name.clone(),
            path: self.pipeline.file().display().to_string(),
            place: self.builder.store.relative_path_to(&self.pipeline.file()),
            created: environment.now(),
            host: environment.host.clone(),
            version: format!("{} (build {})", environment.version, environment.build),
            overrides: self.pipeline.overrides.clone(),
            ..run
        };
        if !self.builder.store.is_new_run(&run)? {
            return Ok(());
        }
        let mut results = BTreeMap::new();
        for stage in &run.stages {
            results.extend(self.results(stage)?);
        }
        self.builder.store.put_run(&Run { results, ..run })
    }

    /// What the artifact of a stage is worth in numbers: what the last run that had it said, or what stands in it. What cannot be read is
    /// damage that the next run finds, and no reason not to remember this one.
    fn results(&self, stage: &RunStage) -> Result<Vec<(String, f64)>, StoreError> {
        let Some(spec) = self.pipeline.stage(&stage.name) else {
            return Ok(Vec::new());
        };
        let prefix = format!("{}.", stage.name);
        if let Some((run, _)) = self
            .planner
            .remembered(spec)?
            .filter(|(_, then)| then.artifact == stage.artifact)
        {
            let known = run
                .results
                .range(prefix.clone()..)
                .take_while(|(name, _)| name.starts_with(&prefix));
            let known: Vec<(String, f64)> = known.map(|(name, value)| (name.clone(), *value)).collect();
            if !known.is_empty() {
                return Ok(known);
            }
        }
        // What nothing needed is not brought from elsewhere to be told of.
        if self.builder.store.has_upstream() && !self.builder.store.has(&stage.artifact) {
            return Ok(Vec::new());
        }
        let found = self.builder.store.artifact(&stage.artifact).map_err(StageError::from);
        match found.and_then(|artifact| spec.kind.results(&artifact)) {
            Ok(results) => {
                // Of nothing there is no mean.
                let finite = results.into_iter().filter(|(_, value)| value.is_finite());
                Ok(finite.map(|(name, value)| (prefix.clone() + &name, value)).collect())
            }
            Err(error) => {
                let text = format!("the results of `{}` are not remembered: {error}", stage.name);
                (self.builder.listener)(&Event::Warning { text });
                Ok(Vec::new())
            }
        }
    }

    /// Why nothing that needs a stage may run, although the stage is there.
    fn blocked(&self, index: usize, report: &StageReport) -> Option<StageError> {
        let digest = report.digest?;
        let open = || self.builder.store.artifact(&digest);
        match self.pipeline.stages[index].stage.blocks(&open) {
            Ok(None) => None,
            Ok(Some(why)) => Some(StageError::Blocked(why)),
            Err(error) => Some(error),
        }
    }

    fn announce(&self, index: usize, status: &StageStatus, why: &Staleness) {
        let spec = &self.pipeline.stages[index];
        let digest = |need: &usize| self.inputs.get(need).and_then(|input| input.digest);
        let inputs: Vec<Option<ArtifactId>> = spec.needs.iter().map(digest).collect();
        // What cannot be read of past runs is no reason not to build.
        let reasons = plan::reasons(&self.planner, spec, status, &inputs).unwrap_or_else(|_| vec![why.clone()]);
        (self.builder.listener)(&Event::StageStarted {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            steps: cost_estimate::steps(status),
            unit: spec.stage.unit(),
            why: why.clone(),
            reasons: reasons.iter().map(ToString::to_string).collect(),
            price: self.prices.get(&index).copied().flatten(),
        });
    }

    /// A cost that cannot be written is no reason to stop: it is told at the end.
    fn remember_cost(&mut self, spec: &StageSpec, status: &StageStatus, report: &StageReport, unstable: u64) {
        let input_bytes: Option<u64> = spec.needs.iter().map(|need| self.sizes.get(need)).sum();
        let Some(input_bytes) = input_bytes else { return };
        let environment = self.builder.environment;
        let cost = cost_estimate::cost(spec, status, report, unstable, input_bytes, environment);
        if let Some(Err(error)) = cost.map(|cost| self.builder.store.put_cost(&cost)) {
            self.history_error.get_or_insert(error);
        }
    }

    /// The lock file of what has been built or found.
    fn lock_file(&self) -> LockFile {
        let stages = self.remembered.values().map(|stage| {
            let locked = LockedStage {
                key: stage.key,
                artifact: stage.artifact,
            };
            (stage.name.clone(), locked)
        });
        LockFile {
            pipeline: self.pipeline.name.clone(),
            target: self.builder.environment.target.clone(),
            stages: stages.collect(),
        }
    }

    fn failed(&self, index: usize, start: SystemTime, error: &StageError) -> StageReport {
        let report = StageReport {
            outcome: match error {
                StageError::Stopped(_) => Outcome::Stopped,
                _ => Outcome::Failed,
            },
            seconds: self.builder.environment.seconds_since(start),
            why: Some(error.to_string()),
            ..self.unbuilt(index)
        };
        (self.builder.listener)(&Event::StageFailed(report.clone()));
        report
    }

    /// The report of a stage that needs something that was not built.
    fn skipped(&self, index: usize, reports: &BTreeMap<usize, StageReport>) -> Option<StageReport> {
        let spec = &self.pipeline.stages[index];
        let waits_for = spec.waits_for();
        let missing = waits_for.iter().find(|need| !self.inputs.contains_key(need))?;
        let report = self.skip(index, *missing, reports);
        (self.builder.listener)(&Event::StageSkipped(report.clone()));
        Some(report)
    }

    /// The report of a stage that needs one that is missing, or was skipped itself.
    fn skip(&self, index: usize, missing: usize, reports: &BTreeMap<usize, StageReport>) -> StageReport {
        let name = &self.pipeline.stages[missing].name;
        let first = reports.get(&missing).and_then(|report| report.missing.clone());
        StageReport {
            outcome: Outcome::Skipped,
            why: Some(format!("needs `{name}`, which failed or was not built")),
            missing: Some(first.unwrap_or_else(|| name.clone())),
            ..self.unbuilt(index)
        }
    }

    fn unbuilt(&self, index: usize) -> StageReport {
        let spec = &self.pipeline.stages[index];
        StageReport::new(&spec.name, spec.kind.name(), Outcome::Skipped)
    }
}
