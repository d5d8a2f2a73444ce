//! What a run would build and why, without building anything.

use super::assess::{Assessment, State, Surveyor};
use super::event::{Outcome, StageReport};
use super::execute::RunError;
use super::foresight;
use super::kind::Plan;
use super::provenance::Environment;
use super::spec::{Pipeline, StageSpec};
use super::staleness::Staleness;
use crate::base::ArtifactId;
use crate::store::{Store, StoreError};

/// Says of each stage, in topological order, whether it would be built, why, and what that would take. `until` names the
/// last stage.
///
/// # Errors
/// When there is no such stage, or the store cannot be read.
pub fn plan(
    pipeline: &Pipeline,
    store: &Store,
    until: Option<&str>,
    environment: &Environment,
) -> Result<Vec<StageReport>, RunError> {
    let selection = pipeline.selection(until)?;
    let surveyor = Surveyor::new(pipeline, store)?;
    let assessments = surveyor.survey(&selection)?;
    let prices = foresight::prices(pipeline, &selection, &assessments, store, environment)?;
    let mut reports = Vec::with_capacity(selection.len());
    for ((&index, assessment), price) in selection.iter().zip(&assessments).zip(prices) {
        let spec = &pipeline.stages[index];
        let mut report = report(spec, assessment);
        let inputs = digests_of(spec, &selection, &assessments);
        let reasons = reasons(&surveyor, spec, assessment, &inputs)?;
        report.reasons = reasons.iter().map(ToString::to_string).collect();
        report.price = price;
        reports.push(report);
    }
    Ok(reports)
}

/// What is known of the artifacts that a stage needs.
pub fn digests_of(spec: &StageSpec, selection: &[usize], assessments: &[Assessment]) -> Vec<Option<ArtifactId>> {
    let digest = |need: &usize| {
        let at = selection.iter().position(|index| index == need);
        at.and_then(|at| assessments[at].artifact())
    };
    spec.needs.iter().map(digest).collect()
}

/// All that makes a stage stale; nothing where it is not.
///
/// # Errors
/// When the store cannot be read.
pub fn reasons(
    surveyor: &Surveyor<'_>,
    spec: &StageSpec,
    assessment: &Assessment,
    inputs: &[Option<ArtifactId>],
) -> Result<Vec<Staleness>, StoreError> {
    match &assessment.state {
        State::Fresh { .. } => Ok(Vec::new()),
        State::Stale { why, .. } => match why {
            Staleness::ArtifactMissing | Staleness::ArtifactDamaged => Ok(vec![why.clone()]),
            _ => surveyor.reasons(spec, &spec.stage.parameters(), inputs),
        },
    }
}

/// What is known of a stage before anything is built.
pub fn report(spec: &StageSpec, assessment: &Assessment) -> StageReport {
    let total = match &assessment.work {
        Plan::Whole { .. } => 1,
        Plan::Chunks(chunks) => chunks.len() as u64,
    };
    let (outcome, reused, digest, size, staleness) = match &assessment.state {
        State::Fresh { record, size, .. } => (Outcome::Reused, total, Some(record.artifact), *size, None),
        State::Stale { why, chunks, expected } => {
            let reused = chunks.iter().filter(|chunk| chunk.intact).count() as u64;
            (Outcome::Stale, reused, *expected, 0, Some(why.clone()))
        }
    };
    StageReport {
        name: spec.name.clone(),
        kind: spec.kind.name().to_owned(),
        outcome,
        chunks_built: total - reused,
        chunks_reused: reused,
        digest,
        seconds: 0.0,
        size,
        size_built: 0,
        price: None,
        reasons: staleness.iter().map(ToString::to_string).collect(),
        why: staleness.as_ref().map(ToString::to_string),
        staleness,
    }
}
