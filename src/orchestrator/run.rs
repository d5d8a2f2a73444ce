//! Runs a pipeline: builds the stale stages, and writes the history of the run.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::build::Builder;
use super::cost_estimate;
use super::event::{Event, Listener, Outcome, StageReport};
use super::execution::{Execution, Failure};
use super::locked;
use super::plan;
use super::plan_warnings::plan_warnings;
use super::planner::{Planner, StageState, StageStatus};
use super::price::{Price, PriceTotal};
use super::provenance::Environment;
use super::run_error::RunError;
use super::spec::Pipeline;
use deaflow_store::{Command, LockFile, Run, Store, StoreError};

/// Options of a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct RunOptions<'a> {
    /// The last stage, which is built with everything that it needs; all stages if `None`.
    pub until: Option<&'a str>,
    /// Builds only that stage: earlier ones are not touched, even if they are missing.
    pub only: bool,
    /// The command, as written in the history.
    pub command: Command,
    /// Builds everything that can be built although something failed.
    pub keep_going: bool,
    /// The keys and artifacts that the stages must have.
    pub lock: Option<&'a LockFile>,
    /// Path of the log file, relative to the folder of the store.
    pub log: Option<&'a str>,
    /// How many stages that do not need each other may be built in parallel; 0 means 1.
    pub parallel_stages: usize,
    /// Builds only these chunks of the last stage, from first to last; other processes build the rest and assemble the
    /// stage.
    pub chunks: Option<(usize, usize)>,
    /// Builds only these stages and leaves the others to other processes.
    pub stages: Option<&'a BTreeSet<usize>>,
    /// How long to wait for a piece that another process is building; forever if `None`.
    pub patience: Option<Duration>,
    /// Once this is set, nothing more is started, and work that can be resumed stops.
    pub stop: Option<&'a AtomicBool>,
    /// Does not write the run into the history.
    pub skip_history: bool,
}

impl RunOptions<'_> {
    /// Whether other processes build the rest of the pipeline.
    fn is_partial(&self) -> bool {
        self.chunks.is_some() || self.stages.is_some()
    }
}

/// The result of a run.
#[derive(Debug)]
pub struct RunOutcome {
    /// The stages that were reached, in topological order.
    pub stages: Vec<StageReport>,
    /// Number of samples of all stages that have no stable solution.
    pub unstable: u64,
    /// The stages that failed: one, or with `keep_going` possibly more.
    pub failures: Vec<Failure>,
    /// Why the run could not be written into the history (a read-only or full store). Its results are valid.
    pub history_error: Option<StoreError>,
    /// What the stages made, for a lock file.
    pub lock: LockFile,
    /// Warnings that were given before the work.
    pub warnings: Vec<String>,
    /// Duration, s.
    pub seconds: f64,
}

/// Runs a pipeline. A stage that fails ends the run, or with `keep_going` only skips the stages that need it. What was
/// built stays.
///
/// # Errors
/// If there is no stage of the name in `until`, the pipeline differs from its lock file, an input of a stage is
/// certainly wrong, or the store cannot be read or written. The failure of a stage is in the outcome.
pub fn run(
    pipeline: &Pipeline,
    store: &Store,
    options: &RunOptions<'_>,
    environment: &Environment,
    listener: Listener<'_>,
) -> Result<RunOutcome, RunError> {
    let start = (environment.clock)();
    let selection = pipeline.selection(options.until)?;
    if let Some(lock) = options.lock {
        check_locked(pipeline, options.until, store, lock)?;
    }
    let planner = Planner::beside_others(pipeline, store);
    let statuses = planner.statuses(&selection)?;
    plan::check_inputs(pipeline, store, &selection, &statuses)?;
    let prices = cost_estimate::prices(pipeline, &selection, &statuses, store, environment)?;
    let prices: Vec<Option<Price>> = prices.into_iter().map(|(price, _)| price).collect();
    listener(&started(pipeline, &statuses, &prices));
    let warnings = match options.is_partial() {
        false => plan_warnings(pipeline, &reports(pipeline, &selection, &statuses), store)?,
        // The process that divided the work has given them.
        true => Vec::new(),
    };
    for text in warnings.iter().cloned() {
        listener(&Event::Warning { text });
    }
    let builder = Builder {
        store,
        environment,
        listener,
        keep_going: options.keep_going,
        stop: options.stop,
        only: options.chunks.and_then(|chunks| Some((*selection.last()?, chunks))),
        patience: options.patience,
    };
    let first = if options.only {
        selection.len().saturating_sub(1)
    } else {
        0
    };
    let mut execution = Execution {
        pipeline,
        needed: needed(pipeline, &selection, &statuses),
        planner,
        builder: &builder,
        parallel_stages: options.parallel_stages.max(1),
        ours: options.stages,
        lock: options.lock,
        prices: selection.iter().copied().zip(prices).collect(),
        known_statuses: BTreeMap::new(),
        inputs: BTreeMap::new(),
        sizes: BTreeMap::new(),
        completed: BTreeMap::new(),
        history_error: None,
        unstable: BTreeMap::new(),
    };
    for (&index, status) in selection.iter().zip(&statuses).take(first) {
        execution.inputs.insert(index, status.as_input());
        if let StageState::Fresh { record, size, .. } = &status.state {
            execution.sizes.insert(index, *size);
            execution.complete(index, record, Outcome::Reused);
        }
    }
    if !statuses.iter().any(StageStatus::is_stale) {
        // Nothing will be built, so the statuses remain valid.
        execution.known_statuses = selection.iter().copied().zip(statuses).collect();
    }
    let (stages, failures) = execution.run_stages(selection.get(first..).unwrap_or_default());
    let lock = execution.lock_file();
    store.save_index();
    let seconds = environment.seconds_since(start);
    if !options.skip_history {
        let run = Run {
            command: options.command,
            seconds,
            log: options.log.filter(|_| stages.iter().any(is_work)).map(str::to_owned),
            not_begun: match options.is_partial() {
                false => execution.not_started(&selection, &failures),
                true => Vec::new(),
            },
            failures: names(&failures, |failure| !failure.is_stop()),
            stopped: names(&failures, Failure::is_stop),
            ..Run::default()
        };
        let logged = execution.write_history(run);
        execution.history_error = execution.history_error.take().or(logged.err());
    }
    if let Some(reason) = &execution.history_error {
        let text = format!("cannot write this run into the history of the store: {reason}");
        listener(&Event::Warning { text });
    }
    Ok(RunOutcome {
        stages,
        unstable: execution.unstable.values().sum(),
        failures,
        history_error: execution.history_error,
        lock,
        warnings,
        seconds,
    })
}

/// Compares a pipeline with its lock file, as far as possible before any work.
///
/// # Errors
/// If they differ, there is no stage of the name in `until`, or the store cannot be read.
pub fn check_locked(pipeline: &Pipeline, until: Option<&str>, store: &Store, lock: &LockFile) -> Result<(), RunError> {
    let differences = locked::differences(pipeline, &pipeline.selection(until)?, store, lock)?;
    match differences.is_empty() {
        true => Ok(()),
        false => Err(RunError::Locked(differences)),
    }
}

/// Returns the stages of some failures.
fn names(failures: &[Failure], which: impl Fn(&Failure) -> bool) -> Vec<String> {
    let chosen = failures.iter().filter(|failure| which(failure));
    chosen.map(|failure| failure.stage.clone()).collect()
}

/// Whether a stage was worked on.
fn is_work(report: &StageReport) -> bool {
    matches!(report.outcome, Outcome::Built | Outcome::Failed | Outcome::Stopped)
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

/// Returns the reports of stages before any work.
fn reports(pipeline: &Pipeline, selection: &[usize], statuses: &[StageStatus]) -> Vec<StageReport> {
    let each = selection.iter().zip(statuses);
    each.map(|(&index, status)| plan::report(&pipeline.stages[index], status))
        .collect()
}

/// Returns the stages whose artifacts will be read. They are verified completely before, so that damage is found while
/// they can still be rebuilt, not by the stage that reads them.
fn needed(pipeline: &Pipeline, selection: &[usize], statuses: &[StageStatus]) -> BTreeSet<usize> {
    let stale = selection.iter().zip(statuses).filter(|(_, status)| status.is_stale());
    stale.flat_map(|(&index, _)| pipeline.stages[index].reads()).collect()
}
