//! What a run would build and why, without building anything.

use super::assess::{Assessment, State, Surveyor};
use super::event::{Outcome, StageReport};
use super::execute::RunError;
use super::kind::Plan;
use super::spec::{Pipeline, StageSpec};
use crate::store::Store;

/// Says of each stage, in topological order, whether it would be built, and why. `until` names the last stage.
///
/// # Errors
/// When there is no such stage, or the store cannot be read.
pub fn plan(pipeline: &Pipeline, store: &Store, until: Option<&str>) -> Result<Vec<StageReport>, RunError> {
    let selection = pipeline.selection(until)?;
    let assessments = Surveyor::new(pipeline, store)?.survey(&selection)?;
    let stages = selection.iter().map(|&index| &pipeline.stages[index]);
    Ok(stages
        .zip(&assessments)
        .map(|(spec, assessment)| report(spec, assessment))
        .collect())
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
        why: staleness.as_ref().map(ToString::to_string),
        staleness,
    }
}
