//! Runs a pipeline: stage after stage in topological order, building what is stale and no more.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::SystemTime;

use super::build::{Builder, Done};
use super::cost_estimate;
use super::difference::Difference;
use super::event::{Event, Listener, Outcome, StageReport};
use super::kind::{Input, Plan, StageError};
use super::locked;
use super::plan;
use super::planner::{self, Planner, StageStatus, State};
use super::price::{Bill, Price};
use super::provenance::Environment;
use super::spec::{Pipeline, StageSpec};
use super::staleness::Staleness;
use crate::base::{ArtifactId, InputError};
use crate::store::{Command, Effort, Ended, LockFile, LockedStage, Record, Run, RunStage, Store, StoreError};

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
    Locked(Vec<Difference>),
}

fn listed(differences: &[Difference]) -> String {
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
    pub not_logged: Option<StoreError>,
    /// What the stages made, to be held to later.
    pub lock: LockFile,
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
        let differences = locked::differences(pipeline, &selection, store, lock)?;
        if !differences.is_empty() {
            return Err(RunError::Locked(differences));
        }
    }
    let planner = Planner::new(pipeline, store);
    let statuses = planner.statuses(&selection)?;
    let prices = cost_estimate::prices(pipeline, &selection, &statuses, store, environment)?;
    listener(&started(pipeline, &statuses, &prices));
    let first = if options.only {
        selection.len().saturating_sub(1)
    } else {
        0
    };
    let before = || selection.iter().zip(&statuses).take(first);
    let known = before().map(|(&index, status)| (index, status.as_input())).collect();
    let remembered = before()
        .filter_map(|(&index, status)| remembered(&pipeline.stages[index], status))
        .collect();
    let mut execution = Execution {
        pipeline,
        read_closely: read_closely(pipeline, &selection, &statuses),
        // Where nothing is stale nothing that happens can change what was found: a rerun looks once.
        known_statuses: match statuses.iter().any(StageStatus::is_stale) {
            true => BTreeMap::new(),
            false => selection.iter().copied().zip(statuses).collect(),
        },
        planner,
        builder: Builder {
            store,
            environment,
            listener,
            keep_going: options.keep_going,
            waited: AtomicBool::new(false),
        },
        lock: options.lock,
        prices: selection.iter().copied().zip(prices).collect(),
        inputs: known,
        sizes: BTreeMap::new(),
        remembered,
        not_logged: None,
        unstable: 0,
    };
    let (stages, failures) = execution.stages(selection.get(first..).unwrap_or_default());
    let lock = execution.lock_file();
    store.keep_index();
    let stages_done = std::mem::take(&mut execution.remembered);
    let logged = execution.log(Run {
        command: options.command,
        seconds: environment.seconds_since(began),
        log: options.log.filter(|_| stages.iter().any(is_work)).map(str::to_owned),
        stages: stages_done,
        failures: failures.iter().map(|failure| failure.stage.clone()).collect(),
        ..Run::default()
    });
    let not_logged = execution.not_logged.or(logged.err());
    if let Some(reason) = &not_logged {
        let text = format!("the store does not remember this run: {reason}");
        listener(&Event::Warning { text });
    }
    Ok(RunOutcome {
        stages,
        unstable: execution.unstable,
        failures,
        not_logged,
        lock,
    })
}

/// Whether anything was done for a stage.
fn is_work(report: &StageReport) -> bool {
    matches!(report.outcome, Outcome::Built | Outcome::Failed)
}

/// A stage that is there and is not looked at any more.
fn remembered(spec: &StageSpec, status: &StageStatus) -> Option<RunStage> {
    match &status.state {
        State::Fresh { record, .. } => Some(RunStage {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            key: record.key,
            artifact: record.artifact,
            outcome: Ended::Reused,
        }),
        State::Stale { .. } => None,
    }
}

fn started(pipeline: &Pipeline, statuses: &[StageStatus], prices: &[Option<Price>]) -> Event {
    let stale = statuses.iter().zip(prices).filter(|(status, _)| status.is_stale());
    let bill = Bill::of(stale.map(|(_, price)| *price));
    Event::RunStarted {
        pipeline: pipeline.name.clone(),
        stages: statuses.len(),
        stale: bill.stale,
        price: bill.price,
        unpriced: bill.unpriced,
    }
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
    builder: Builder<'a>,
    lock: Option<&'a LockFile>,
    read_closely: BTreeSet<usize>,
    known_statuses: BTreeMap<usize, StageStatus>,
    prices: BTreeMap<usize, Option<Price>>,
    inputs: BTreeMap<usize, Input>,
    sizes: BTreeMap<usize, u64>,
    remembered: Vec<RunStage>,
    not_logged: Option<StoreError>,
    unstable: u64,
}

impl Execution<'_> {
    /// Goes through the stages until one fails, or through all that can be built.
    fn stages(&mut self, selection: &[usize]) -> (Vec<StageReport>, Vec<Failure>) {
        let mut reports = Vec::with_capacity(selection.len());
        let mut failures = Vec::new();
        for &index in selection {
            if let Some(skipped) = self.skipped(index) {
                reports.push(skipped);
                continue;
            }
            let start = (self.builder.environment.clock)();
            let failure = match self.stage(index, start) {
                Ok(report) => {
                    let blocked = self.blocked(index, &report);
                    reports.push(report);
                    blocked
                }
                Err(error) => {
                    reports.push(self.failed(index, start, &error));
                    Some(error)
                }
            };
            if let Some(error) = failure {
                // It may be there, as an audit that stops what follows is: for what follows it is not.
                self.inputs.remove(&index);
                failures.push(Failure {
                    stage: self.pipeline.stages[index].name.clone(),
                    error,
                });
                if !self.builder.keep_going {
                    break;
                }
            }
        }
        (reports, failures)
    }

    fn stage(&mut self, index: usize, start: SystemTime) -> Result<StageReport, StageError> {
        let spec = &self.pipeline.stages[index];
        let needed = spec.needs.iter().filter_map(|need| self.inputs.get(need).cloned());
        let inputs: Vec<Input> = needed.collect();
        let status = match self.known_statuses.remove(&index) {
            Some(status) => status,
            None => {
                let closely = self.read_closely.contains(&index);
                let effort = if closely { Effort::Thorough } else { Effort::Quick };
                self.planner.status(index, &inputs, effort)?
            }
        };
        let mut report = plan::report(spec, &status);
        let (record, known) = match &status.state {
            State::Fresh { record, .. } => ((**record).clone(), status.as_input()),
            State::Stale { why, .. } => {
                self.announce(index, &status, why);
                let (record, parts) = self.build(spec, &status, &mut report)?;
                let known = planner::known(&status.work, Some(record.artifact), &parts);
                (record, known)
            }
        };
        report.digest = Some(record.artifact);
        report.seconds = self.builder.environment.seconds_since(start);
        report.price = self.prices.get(&index).copied().flatten();
        let waited = self.builder.waited.swap(false, Ordering::Relaxed);
        if report.outcome == Outcome::Built && !waited {
            self.remember_cost(spec, &status, &report);
        }
        if let Some(difference) = self.lock.and_then(|lock| locked::other_artifact(spec, lock, &record)) {
            return Err(difference.into());
        }
        self.inputs.insert(index, known);
        self.sizes.insert(index, report.size);
        self.unstable += record.unstable;
        (self.builder.listener)(&match report.outcome {
            Outcome::Reused => Event::StageReused(report.clone()),
            _ => Event::StageFinished(report.clone()),
        });
        self.remembered.push(RunStage {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            key: record.key,
            artifact: record.artifact,
            outcome: match report.outcome {
                Outcome::Built => Ended::Built,
                _ => Ended::Reused,
            },
        });
        Ok(report)
    }

    /// Remembers what has been run, where that is news.
    fn log(&self, run: Run) -> Result<(), StoreError> {
        let environment = self.builder.environment;
        let run = Run {
            pipeline: self.pipeline.name.clone(),
            path: self.pipeline.file().display().to_string(),
            place: self.builder.store.as_seen_from_here(&self.pipeline.file()),
            created: environment.now(),
            host: environment.host.clone(),
            version: format!("{} (build {})", environment.version, environment.build),
            overrides: self.pipeline.overrides.clone(),
            ..run
        };
        if !self.builder.store.is_news(&run)? {
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
        (self.builder.listener)(&Event::StageStarted {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            steps: cost_estimate::steps(status),
            why: why.clone(),
            price: self.prices.get(&index).copied().flatten(),
        });
    }

    /// A cost that cannot be written is no reason to stop: it is told at the end.
    fn remember_cost(&mut self, spec: &StageSpec, status: &StageStatus, report: &StageReport) {
        let input_bytes = spec.needs.iter().filter_map(|need| self.sizes.get(need)).sum();
        let environment = self.builder.environment;
        let cost = cost_estimate::cost(spec, status, report, input_bytes, environment);
        if let Some(Err(error)) = cost.map(|cost| self.builder.store.put_cost(&cost)) {
            self.not_logged.get_or_insert(error);
        }
    }

    /// The lock file of what has been built or found.
    fn lock_file(&self) -> LockFile {
        let stages = self.remembered.iter().map(|stage| {
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

    /// Builds a stale stage; gives its record and its chunks.
    fn build(
        &self,
        spec: &StageSpec,
        status: &StageStatus,
        report: &mut StageReport,
    ) -> Result<(Record, Vec<Option<ArtifactId>>), StageError> {
        let (Some((action, key)), State::Stale { chunks: states, .. }) = (&status.action, &status.state) else {
            return Err(StageError::Failed("the stage is not ready to be built".into()));
        };
        let done: Vec<Done> = match &status.work {
            Plan::Whole { .. } => vec![self.builder.whole(spec, action, *key)?],
            Plan::Chunks(chunks) => self.builder.chunks(spec, chunks, states)?,
        };
        report.chunks_built = done.iter().filter(|done| done.built).count() as u64;
        report.chunks_reused = done.len() as u64 - report.chunks_built;
        report.size = done.iter().map(|done| done.record.size).sum();
        let built = done.iter().filter(|done| done.built);
        report.size_built = built.map(|done| done.record.size).sum();
        report.outcome = Outcome::Built;
        if matches!(status.work, Plan::Whole { .. }) {
            // Another process may have built it while this one waited.
            if report.chunks_built == 0 {
                report.outcome = Outcome::Reused;
            }
            return done
                .into_iter()
                .next()
                .map(|done| (done.record, Vec::new()))
                .ok_or_else(nothing);
        }
        let parts: Vec<ArtifactId> = done.iter().map(|done| done.record.artifact).collect();
        let seconds = done
            .iter()
            .filter(|done| done.built)
            .map(|done| done.record.seconds)
            .sum();
        let record = self.builder.manifest(spec, action, *key, parts.clone(), seconds)?;
        report.size += record.size;
        report.size_built += record.size;
        Ok((record, parts.into_iter().map(Some).collect()))
    }

    fn failed(&self, index: usize, start: SystemTime, error: &StageError) -> StageReport {
        let report = StageReport {
            outcome: Outcome::Failed,
            seconds: self.builder.environment.seconds_since(start),
            why: Some(error.to_string()),
            ..self.unbuilt(index)
        };
        (self.builder.listener)(&Event::StageFailed(report.clone()));
        report
    }

    /// The report of a stage that needs something that was not built.
    fn skipped(&self, index: usize) -> Option<StageReport> {
        let spec = &self.pipeline.stages[index];
        let waits_for = spec.waits_for();
        let missing = waits_for.iter().find(|need| !self.inputs.contains_key(need))?;
        let report = StageReport {
            outcome: Outcome::Skipped,
            why: Some(format!(
                "needs `{}`, which failed or was not built",
                self.pipeline.stages[*missing].name
            )),
            ..self.unbuilt(index)
        };
        (self.builder.listener)(&Event::StageSkipped(report.clone()));
        Some(report)
    }

    fn unbuilt(&self, index: usize) -> StageReport {
        let spec = &self.pipeline.stages[index];
        StageReport {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            outcome: Outcome::Skipped,
            chunks_built: 0,
            chunks_reused: 0,
            digest: None,
            seconds: 0.0,
            size: 0,
            size_built: 0,
            price: None,
            why: None,
            reasons: Vec::new(),
            staleness: None,
        }
    }
}

fn nothing() -> StageError {
    StageError::Failed("nothing was built".into())
}
