//! Runs a pipeline: stage after stage in topological order, building what is stale and no more.

use std::collections::{BTreeMap, BTreeSet};
use std::time::SystemTime;

use super::assess::{self, Assessment, State, Surveyor};
use super::build::{Builder, Done};
use super::event::{Event, Listener, Outcome, StageReport};
use super::kind::{Input, Plan, StageError};
use super::plan;
use super::provenance::Environment;
use super::spec::{Pipeline, StageSpec};
use super::staleness::Staleness;
use crate::base::{Digest, InputError};
use crate::store::{Effort, Record, Run, RunStage, Store, StoreError};

/// Why a run or a plan could not be made.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The stage to stop at does not exist.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The store refused, apart from any stage.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// What a run has done.
#[derive(Debug)]
pub struct RunOutcome {
    /// The stages that were reached, in topological order.
    pub stages: Vec<StageReport>,
    /// How many samples, over all stages, have no stable solution.
    pub unstable: u64,
    /// Why the last of the stages failed, if it did.
    pub failure: Option<StageError>,
    /// Why the run is not remembered, if it is not (a read-only or full store): its results are none the worse.
    pub not_logged: Option<StoreError>,
}

/// Runs a pipeline up to the stage `until`, or all of it. A stage that fails ends the run; what was built stays.
///
/// # Errors
/// When there is no such stage, or the store cannot be read or written; a stage's own failure is in the outcome.
pub fn run(
    pipeline: &Pipeline,
    store: &Store,
    until: Option<&str>,
    environment: &Environment,
    listener: Listener<'_>,
) -> Result<RunOutcome, RunError> {
    let selection = pipeline.selection(until)?;
    let surveyor = Surveyor::new(pipeline, store)?;
    let mut execution = Execution {
        pipeline,
        read_closely: read_closely(pipeline, &selection, &surveyor.survey(&selection)?),
        surveyor,
        builder: Builder {
            store,
            environment,
            listener,
        },
        inputs: BTreeMap::new(),
        remembered: Vec::new(),
        unstable: 0,
    };
    listener(&Event::RunStarted {
        pipeline: pipeline.name.clone(),
        stages: selection.len(),
    });
    let (stages, failure) = execution.stages(&selection);
    let logged = store.put_run(&Run {
        pipeline: pipeline.name.clone(),
        path: pipeline.path.display().to_string(),
        created: environment.now(),
        stages: execution.remembered,
    });
    Ok(RunOutcome {
        stages,
        unstable: execution.unstable,
        failure,
        not_logged: logged.err(),
    })
}

/// The stages whose artifacts are going to be read. They are verified in full beforehand, so that damage is found while
/// they can still be rebuilt, and not by the stage that reads them.
fn read_closely(pipeline: &Pipeline, selection: &[usize], assessments: &[Assessment]) -> BTreeSet<usize> {
    let stale = selection
        .iter()
        .zip(assessments)
        .filter(|(_, assessment)| assessment.is_stale());
    stale
        .flat_map(|(&index, _)| pipeline.stages[index].needs.iter().copied())
        .collect()
}

struct Execution<'a> {
    pipeline: &'a Pipeline,
    surveyor: Surveyor<'a>,
    builder: Builder<'a>,
    read_closely: BTreeSet<usize>,
    inputs: BTreeMap<usize, Input>,
    remembered: Vec<RunStage>,
    unstable: u64,
}

impl Execution<'_> {
    /// Goes through the stages until one fails.
    fn stages(&mut self, selection: &[usize]) -> (Vec<StageReport>, Option<StageError>) {
        let mut reports = Vec::with_capacity(selection.len());
        let mut effort = Effort::quick();
        for &index in selection {
            let start = (self.builder.environment.clock)();
            match self.stage(index, start, &mut effort) {
                Ok(report) => reports.push(report),
                Err(error) => {
                    reports.push(self.failed(index, start, &error));
                    return (reports, Some(error));
                }
            }
        }
        (reports, None)
    }

    fn stage(&mut self, index: usize, start: SystemTime, quick: &mut Effort) -> Result<StageReport, StageError> {
        let spec = &self.pipeline.stages[index];
        let needed = spec.needs.iter().filter_map(|need| self.inputs.get(need).cloned());
        let inputs: Vec<Input> = needed.collect();
        let mut thorough = Effort::thorough();
        let effort = match self.read_closely.contains(&index) {
            true => &mut thorough,
            false => quick,
        };
        let assessment = self.surveyor.assess(index, &inputs, effort)?;
        let mut report = plan::report(spec, &assessment);
        let (record, known) = match &assessment.state {
            State::Fresh { record, .. } => ((**record).clone(), assessment.as_input()),
            State::Stale { why, .. } => {
                self.announce(spec, &assessment, why);
                let (record, parts) = self.build(spec, &assessment, &mut report)?;
                let known = assess::known(&assessment.work, Some(record.artifact), &parts);
                (record, known)
            }
        };
        self.inputs.insert(index, known);
        self.unstable += record.unstable;
        report.digest = Some(record.artifact);
        report.seconds = self.builder.environment.seconds_since(start);
        (self.builder.listener)(&match report.outcome {
            Outcome::Reused => Event::StageReused(report.clone()),
            _ => Event::StageFinished(report.clone()),
        });
        self.remembered.push(RunStage {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            key: record.key,
            artifact: record.artifact,
        });
        Ok(report)
    }

    fn announce(&self, spec: &StageSpec, assessment: &Assessment, why: &Staleness) {
        let steps = match (&assessment.work, &assessment.state) {
            (Plan::Chunks(chunks), State::Stale { chunks: states, .. }) => {
                let missing = chunks.iter().zip(states).filter(|(_, state)| !state.intact);
                missing.map(|(chunk, _)| chunk.samples).sum()
            }
            (Plan::Whole { steps }, _) => *steps,
            _ => 0,
        };
        (self.builder.listener)(&Event::StageStarted {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            steps,
            why: why.clone(),
        });
    }

    /// Builds a stale stage; gives its record and its chunks.
    fn build(
        &self,
        spec: &StageSpec,
        assessment: &Assessment,
        report: &mut StageReport,
    ) -> Result<(Record, Vec<Option<Digest>>), StageError> {
        let (Some((action, key)), State::Stale { chunks: states, .. }) = (&assessment.action, &assessment.state) else {
            return Err(StageError::Failed("the stage is not ready to be built".into()));
        };
        let done: Vec<Done> = match &assessment.work {
            Plan::Whole { .. } => vec![self.builder.whole(spec, action, *key)?],
            Plan::Chunks(chunks) => self.builder.chunks(spec, chunks, states)?,
        };
        report.chunks_built = done.iter().filter(|done| done.built).count() as u64;
        report.chunks_reused = done.len() as u64 - report.chunks_built;
        report.size = done.iter().map(|done| done.record.size).sum();
        report.outcome = Outcome::Built;
        if matches!(assessment.work, Plan::Whole { .. }) {
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
        let parts: Vec<Digest> = done.iter().map(|done| done.record.artifact).collect();
        let seconds = done
            .iter()
            .filter(|done| done.built)
            .map(|done| done.record.seconds)
            .sum();
        let record = self.builder.manifest(spec, action, *key, parts.clone(), seconds)?;
        report.size += record.size;
        Ok((record, parts.into_iter().map(Some).collect()))
    }

    fn failed(&self, index: usize, start: SystemTime, error: &StageError) -> StageReport {
        let spec = &self.pipeline.stages[index];
        let report = StageReport {
            name: spec.name.clone(),
            kind: spec.kind.name().to_owned(),
            outcome: Outcome::Failed,
            chunks_built: 0,
            chunks_reused: 0,
            digest: None,
            seconds: self.builder.environment.seconds_since(start),
            size: 0,
            why: Some(error.to_string()),
            staleness: None,
        };
        (self.builder.listener)(&Event::StageFailed(report.clone()));
        report
    }
}

fn nothing() -> StageError {
    StageError::Failed("nothing was built".into())
}
