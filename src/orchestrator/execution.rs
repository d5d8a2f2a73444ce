//! The state of a run, and how one stage is started, finished and reported.

use std::collections::{BTreeMap, BTreeSet};
use std::time::SystemTime;

use super::build::Builder;
use super::cost_estimate;
use super::event::{Event, Outcome, StageReport};
use super::kind::{Input, Plan, StageError};
use super::locked;
use super::plan;
use super::planner::{self, Planner, StageState, StageStatus};
use super::price::Price;
use super::spec::{Pipeline, StageSpec};
use super::stage_work::{FinishedWork, StageWork};
use super::staleness::Staleness;
use deaflow_base::ArtifactId;
use deaflow_store::{Effort, LockFile, Record, RunStage, StageOutcome, StoreError};

/// A stage that could not be built.
#[derive(Debug)]
pub struct Failure {
    /// The stage.
    pub stage: String,
    /// The reason.
    pub error: StageError,
}

impl Failure {
    /// Whether the stage was only stopped.
    #[must_use]
    pub fn is_stop(&self) -> bool {
        matches!(self.error, StageError::Stopped(_))
    }
}

/// The state of a run. Stages are identified by their indices in the pipeline.
pub struct Execution<'a> {
    pub pipeline: &'a Pipeline,
    pub planner: Planner<'a>,
    pub builder: &'a Builder<'a>,
    pub parallel_stages: usize,
    /// The stages that this process builds; all if `None`.
    pub ours: Option<&'a BTreeSet<usize>>,
    pub lock: Option<&'a LockFile>,
    /// Stages whose artifacts are read by others, and are therefore verified completely.
    pub needed: BTreeSet<usize>,
    /// Statuses that need not be determined again.
    pub known_statuses: BTreeMap<usize, StageStatus>,
    pub prices: BTreeMap<usize, Option<Price>>,
    /// The stages that exist, as inputs of others.
    pub inputs: BTreeMap<usize, Input>,
    /// Lengths of the files of stages, bytes.
    pub sizes: BTreeMap<usize, u64>,
    /// The stages that exist, for history and lock file.
    pub completed: BTreeMap<usize, RunStage>,
    /// The first error in writing the history.
    pub history_error: Option<StoreError>,
    /// Samples without a stable solution.
    pub unstable: BTreeMap<usize, u64>,
}

/// The stages that have ended.
#[derive(Default)]
pub struct EndedStages {
    pub reports: BTreeMap<usize, StageReport>,
    pub failures: BTreeMap<usize, Failure>,
}

/// What starting a stage has led to.
pub enum Started {
    /// It exists already.
    Exists(Box<StageReport>),
    /// It has to be built.
    Work(Box<StageWork>),
    /// It is left to other processes.
    LeftToOthers,
    /// Another process is building it.
    Busy,
    /// It has to be built, and before it these stages that it needs: they cannot be downloaded.
    Lost(Vec<usize>),
}

impl Execution<'_> {
    /// Determines what has to be done for a stage whose needs all exist. `waits`: whether it is started although
    /// another process is building it.
    pub fn start(&mut self, index: usize, start: SystemTime, waits: bool) -> Result<Started, StageError> {
        let spec = &self.pipeline.stages[index];
        let status = match self.known_statuses.remove(&index) {
            Some(status) => status,
            None => {
                let is_needed = self.needed.contains(&index);
                let effort = if is_needed { Effort::Thorough } else { Effort::Quick };
                self.planner.status(index, &self.inputs, effort)?
            }
        };
        let report = plan::report(spec, &status);
        match &status.state {
            StageState::Fresh { record, .. } => {
                let report = self.add_artifact(index, start, report, record, status.as_input())?;
                Ok(Started::Exists(Box::new(report)))
            }
            StageState::Stale { .. } if self.ours.is_some_and(|ours| !ours.contains(&index)) => {
                Ok(Started::LeftToOthers)
            }
            StageState::Stale { .. } if !waits && self.is_busy(&status)? => Ok(Started::Busy),
            StageState::Stale { why, .. } => {
                let lost = self.lost_inputs(index)?;
                if !lost.is_empty() {
                    return Ok(Started::Lost(lost));
                }
                self.announce(index, &status, why);
                Ok(Started::Work(Box::new(StageWork {
                    index,
                    start,
                    waits,
                    status,
                    report,
                })))
            }
        }
    }

    /// Returns stages and all that need them, directly or indirectly.
    fn with_dependants(&self, stages: Vec<usize>) -> BTreeSet<usize> {
        let mut found: BTreeSet<usize> = stages.into_iter().collect();
        // The stages are in topological order.
        for (index, stage) in self.pipeline.stages.iter().enumerate() {
            if stage.waits_for().iter().any(|need| found.contains(need)) {
                found.insert(index);
            }
        }
        found
    }

    /// Forgets lost stages and what was made from them, because that may change. Returns those that had ended.
    pub fn reset(&mut self, lost: Vec<usize>, ended: &mut EndedStages) -> Vec<usize> {
        let mut again = Vec::new();
        for index in self.with_dependants(lost) {
            if ended.reports.remove(&index).is_some() {
                self.inputs.remove(&index);
                self.unstable.remove(&index);
                self.completed.remove(&index);
                again.push(index);
            }
        }
        again
    }

    /// Returns the needs of a stage that are in the upstream store only and cannot be downloaded, so that they have to
    /// be built.
    fn lost_inputs(&mut self, index: usize) -> Result<Vec<usize>, StoreError> {
        let mut lost = Vec::new();
        if !self.builder.store.has_upstream() {
            return Ok(lost);
        }
        for need in self.pipeline.stages[index].reads() {
            if !self.needed.insert(need) {
                continue;
            }
            let status = self.planner.status(need, &self.inputs, Effort::Thorough)?;
            if status.is_stale() {
                lost.push(need);
            }
        }
        Ok(lost)
    }

    /// Whether another process is building a stage that is one piece of work.
    fn is_busy(&self, status: &StageStatus) -> Result<bool, StoreError> {
        match (&status.work, &status.action) {
            (Plan::Whole { .. }, Some((_, key))) => self.builder.store.is_busy(key),
            _ => Ok(false),
        }
    }

    fn announce(&self, index: usize, status: &StageStatus, why: &Staleness) {
        let spec = &self.pipeline.stages[index];
        let digest = |need: &usize| self.inputs.get(need).and_then(|input| input.digest);
        let inputs: Vec<Option<ArtifactId>> = spec.needs.iter().map(digest).collect();
        // Past runs that cannot be read do not prevent building.
        let reasons = plan::reasons(&self.planner, spec, status, &inputs).unwrap_or_else(|_| vec![why.clone()]);
        (self.builder.listener)(&Event::StageStarted {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            steps: cost_estimate::steps(status),
            unit: spec.stage().unit(),
            why: why.clone(),
            reasons: reasons.iter().map(ToString::to_string).collect(),
            price: self.prices.get(&index).copied().flatten(),
        });
    }

    /// Adds a stage that has been built. `share` is its share of the time of the run in s, if stages are built in
    /// parallel.
    pub fn finish(&mut self, done: FinishedWork, share: Option<f64>) -> Result<StageReport, StageError> {
        let FinishedWork { work, result, waited } = done;
        let StageWork {
            index,
            start,
            status,
            mut report,
            ..
        } = *work;
        let result = result?;
        result.write_to(&mut report);
        report.part = share;
        let spec = &self.pipeline.stages[index];
        let Some(record) = result.record else {
            // Other processes build its other chunks.
            report.seconds = self.builder.environment.seconds_since(start);
            (self.builder.listener)(&Event::StageFinished(report.clone()));
            return Ok(report);
        };
        let input = planner::as_input(&status.work, Some(record.artifact), &result.parts);
        let report = self.add_artifact(index, start, report, &record, input)?;
        if !result.is_size_complete {
            self.sizes.remove(&index);
        }
        if report.outcome == Outcome::Built && !waited {
            self.write_cost(spec, &status, &report, record.unstable);
        }
        Ok(report)
    }

    /// Makes the artifact of a stage available to later stages, after comparing it with the lock file.
    fn add_artifact(
        &mut self,
        index: usize,
        start: SystemTime,
        mut report: StageReport,
        record: &Record,
        input: Input,
    ) -> Result<StageReport, StageError> {
        let spec = &self.pipeline.stages[index];
        report.digest = Some(record.artifact);
        report.seconds = self.builder.environment.seconds_since(start);
        report.price = self.prices.get(&index).copied().flatten();
        if let Some(difference) = self.lock.and_then(|lock| locked::other_artifact(spec, lock, record)) {
            return Err(difference.into());
        }
        self.inputs.insert(index, input);
        self.sizes.insert(index, report.size);
        self.unstable.insert(index, record.unstable);
        (self.builder.listener)(&match report.outcome {
            Outcome::Reused => Event::StageReused(report.clone()),
            _ => Event::StageFinished(report.clone()),
        });
        self.complete(index, record, report.outcome);
        Ok(report)
    }

    /// Notes that the artifact of a stage exists, for history and lock file.
    pub fn complete(&mut self, index: usize, record: &Record, outcome: Outcome) {
        let spec = &self.pipeline.stages[index];
        let stage = RunStage {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            key: record.key,
            artifact: record.artifact,
            outcome: match outcome {
                Outcome::Built => StageOutcome::Built,
                _ => StageOutcome::Reused,
            },
            from_scene: spec.from_scene.clone(),
        };
        self.completed.insert(index, stage);
    }

    /// Adds the report of a stage that has ended, and its failure if it failed or blocks later stages.
    pub fn end(
        &mut self,
        index: usize,
        start: SystemTime,
        report: Result<StageReport, StageError>,
        ended: &mut EndedStages,
    ) {
        let (report, error) = match report {
            Ok(report) => {
                let blocked = self.blocked(index, &report);
                (report, blocked)
            }
            Err(error) => (self.failed(index, start, &error), Some(error)),
        };
        ended.reports.insert(index, report);
        if let Some(error) = error {
            // Its artifact may exist, as that of an audit that stops the pipeline; later stages must not use it.
            self.inputs.remove(&index);
            let stage = self.pipeline.stages[index].name.clone();
            ended.failures.insert(index, Failure { stage, error });
        }
    }

    /// Returns why no stage that needs this one may run although it exists.
    fn blocked(&self, index: usize, report: &StageReport) -> Option<StageError> {
        let digest = report.digest?;
        let open = || self.builder.store.artifact(&digest);
        match self.pipeline.stages[index].stage().blocks(&open) {
            Ok(why) => why.map(StageError::Blocked),
            Err(error) => Some(error),
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
            ..self.skipped_report(index)
        };
        (self.builder.listener)(&Event::StageFailed(report.clone()));
        report
    }

    /// Returns the report of a stage if one that it waits for does not exist.
    pub fn skip_if_missing(&self, index: usize, reports: &BTreeMap<usize, StageReport>) -> Option<StageReport> {
        let waits_for = self.pipeline.stages[index].waits_for();
        let missing = waits_for.iter().find(|need| !self.inputs.contains_key(need))?;
        let report = self.skip(index, *missing, reports);
        (self.builder.listener)(&Event::StageSkipped(report.clone()));
        Some(report)
    }

    /// Returns the report of a stage that is skipped because another one is missing.
    fn skip(&self, index: usize, missing: usize, reports: &BTreeMap<usize, StageReport>) -> StageReport {
        let name = &self.pipeline.stages[missing].name;
        let first = reports.get(&missing).and_then(|report| report.missing.clone());
        StageReport {
            why: Some(format!("needs `{name}`, which failed or was not built")),
            missing: Some(first.unwrap_or_else(|| name.clone())),
            ..self.skipped_report(index)
        }
    }

    /// Adds reports of the stages that were not started after a failure: because they need the failed stage, or because
    /// the run ended.
    pub fn report_not_started(&self, selection: &[usize], ended: &mut EndedStages) {
        let failed = ended.failures.values().find(|failure| !failure.is_stop());
        let first = failed.map_or_else(String::new, |failure| failure.stage.clone());
        for &index in selection {
            if ended.reports.contains_key(&index) {
                continue;
            }
            let waits_for = self.pipeline.stages[index].waits_for();
            let is_missing = |need: &&usize| {
                let is_skipped = |report: &StageReport| report.outcome == Outcome::Skipped;
                ended.failures.contains_key(need) || ended.reports.get(need).is_some_and(is_skipped)
            };
            let report = match waits_for.iter().find(is_missing) {
                Some(missing) => self.skip(index, *missing, &ended.reports),
                None => StageReport {
                    why: Some(format!("not started: the run ended when `{first}` failed")),
                    ..self.skipped_report(index)
                },
            };
            ended.reports.insert(index, report);
        }
    }

    fn skipped_report(&self, index: usize) -> StageReport {
        let spec: &StageSpec = &self.pipeline.stages[index];
        StageReport::new(&spec.name, spec.kind.name(), Outcome::Skipped)
    }
}
