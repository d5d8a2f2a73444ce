//! Plans: what a run would build, why, and at what cost.

use std::path::Path;

use serde_json::{Value, json};

use super::cost_estimate;
use super::event::{Outcome, StageReport};
use super::kind::Plan;
use super::planner::{Planner, StageState, StageStatus};
use super::price::PriceTotal;
use super::provenance::Environment;
use super::run_error::RunError;
use super::spec::{Pipeline, StageSpec};
use super::staleness::Staleness;
use deaflow_base::{ArtifactId, InputError};
use deaflow_store::{Store, StoreError};

/// Returns a report on each stage, in topological order: whether it would be built, why, and at what cost. `until`
/// names the last stage.
///
/// # Errors
/// If there is no such stage, or the store cannot be read.
pub fn plan(
    pipeline: &Pipeline,
    store: &Store,
    until: Option<&str>,
    environment: &Environment,
) -> Result<Vec<StageReport>, RunError> {
    let selection = pipeline.selection(until)?;
    let planner = Planner::new(pipeline, store);
    let statuses = planner.statuses(&selection)?;
    check_inputs(pipeline, store, &selection, &statuses)?;
    let prices = cost_estimate::prices(pipeline, &selection, &statuses, store, environment)?;
    let mut reports = Vec::with_capacity(selection.len());
    for ((&index, status), price) in selection.iter().zip(&statuses).zip(prices) {
        let spec = &pipeline.stages[index];
        let mut report = report(spec, status);
        let inputs = digests_of(spec, &selection, &statuses);
        let reasons = reasons(&planner, spec, status, &inputs)?;
        report.reasons = reasons.iter().map(ToString::to_string).collect();
        if status.is_stale() {
            report
                .reasons
                .extend(cost_estimate::resumed_text(spec, status, store, environment));
        }
        (report.price, report.unmeasured) = price;
        reports.push(report);
    }
    Ok(reports)
}

/// Adds the prices of the stale stages.
#[must_use]
pub fn price_total(stages: &[StageReport]) -> PriceTotal {
    let stale = stages.iter().filter(|stage| stage.outcome == Outcome::Stale);
    PriceTotal::of(stale.map(|stage| stage.price))
}

/// Returns the JSON document of `deaflow plan --json`: stages, total price and warnings.
#[must_use]
pub fn plan_document(pipeline: &Pipeline, store: &Path, stages: &[StageReport], warnings: &[String]) -> Value {
    let total = price_total(stages);
    json!({
        "pipeline": pipeline.name,
        "store": store,
        "stages": stages,
        "price": total.price,
        "unpriced": total.unpriced,
        "warnings": warnings,
    })
}

/// Lets each stale stage check what is known of its inputs.
///
/// # Errors
/// If one of them would certainly fail, with the position of the reason.
pub fn check_inputs(
    pipeline: &Pipeline,
    store: &Store,
    selection: &[usize],
    statuses: &[StageStatus],
) -> Result<(), InputError> {
    // What is in an upstream store only is not downloaded for a check.
    let open = |digest: &ArtifactId| match store.has(digest) {
        true => store.artifact(digest).ok(),
        false => None,
    };
    let stale = selection.iter().zip(statuses).filter(|(_, status)| status.is_stale());
    for (&index, _) in stale {
        let spec = &pipeline.stages[index];
        let kinds = spec.needs.iter().map(|&need| pipeline.stages[need].kind.name());
        let known: Vec<_> = kinds.zip(digests_of(spec, selection, statuses)).collect();
        spec.stage().check_inputs(&known, &open)?;
    }
    Ok(())
}

/// Returns the artifacts that a stage needs, as far as known.
pub fn digests_of(spec: &StageSpec, selection: &[usize], statuses: &[StageStatus]) -> Vec<Option<ArtifactId>> {
    let digest = |need: &usize| {
        let at = selection.iter().position(|index| index == need);
        at.and_then(|at| statuses[at].artifact())
    };
    spec.needs.iter().map(digest).collect()
}

/// Returns all reasons why a stage is stale.
///
/// # Errors
/// If the store cannot be read.
pub fn reasons(
    planner: &Planner<'_>,
    spec: &StageSpec,
    status: &StageStatus,
    inputs: &[Option<ArtifactId>],
) -> Result<Vec<Staleness>, StoreError> {
    match &status.state {
        StageState::Fresh { .. } => Ok(Vec::new()),
        StageState::Stale { why, .. } => match why {
            Staleness::ArtifactMissing | Staleness::ArtifactDamaged | Staleness::Removed { .. } => {
                Ok(vec![why.clone()])
            }
            _ => planner.reasons(spec, &spec.stage().parameters(), inputs),
        },
    }
}

/// Returns the report on a stage before anything is built.
pub fn report(spec: &StageSpec, status: &StageStatus) -> StageReport {
    let total = match &status.work {
        Plan::Whole { .. } => 1,
        Plan::Chunks(chunks) => chunks.len() as u64,
    };
    let (outcome, reused, digest, size, staleness) = match &status.state {
        StageState::Fresh { record, size, .. } => (Outcome::Reused, total, Some(record.artifact), *size, None),
        StageState::Stale { why, chunks, expected } => {
            let reused = chunks.iter().filter(|chunk| chunk.intact).count() as u64;
            (Outcome::Stale, reused, *expected, 0, Some(why.clone()))
        }
    };
    StageReport {
        chunks_built: total - reused,
        chunks_reused: reused,
        digest,
        size,
        reasons: staleness.iter().map(ToString::to_string).collect(),
        why: staleness.as_ref().map(ToString::to_string),
        staleness,
        ..StageReport::new(&spec.name, spec.kind.name(), outcome)
    }
}
