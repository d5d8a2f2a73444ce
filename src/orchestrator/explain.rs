//! Explains why a stage would be built: all changes since it was last built or reused, not only the first.

use std::collections::BTreeSet;

use super::event::StageReport;
use super::plan::{digests_of, reasons, report};
use super::planner::Planner;
use super::run_error::RunError;
use super::spec::Pipeline;
use super::staleness::Staleness;
use deaflow_base::{ActionKey, ArtifactId};
use deaflow_store::Store;

/// Explanation of the status of a stage.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// The report of the stage, as in a plan.
    pub report: StageReport,
    /// Its action key; unknown until all inputs are built.
    pub key: Option<ActionKey>,
    /// Why it is stale; empty if it is not.
    pub reasons: Vec<Staleness>,
    /// The stages that it needs, with their artifacts as far as known.
    pub inputs: Vec<(String, Option<ArtifactId>)>,
    /// The stages that would be built before it, directly or indirectly, with their own reasons, in topological order.
    pub causes: Vec<(String, Vec<Staleness>)>,
    /// The last run with the same action, otherwise the last with a stage of its name.
    pub last: Option<LastRun>,
}

/// The last run of a stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LastRun {
    /// Whether it did the same action, with the same parameters and inputs.
    pub is_same: bool,
    /// When it ended, in UTC, RFC 3339.
    pub created: String,
    /// The action key in that run.
    pub key: ActionKey,
    /// The artifact in that run.
    pub artifact: ArtifactId,
}

/// Explains a stage.
///
/// # Errors
/// If there is no such stage, or the store cannot be read.
pub fn explain(pipeline: &Pipeline, store: &Store, stage: &str) -> Result<Explanation, RunError> {
    let selection = pipeline.selection(Some(stage))?;
    let planner = Planner::new(pipeline, store);
    let statuses = planner.statuses(&selection)?;
    let at = selection.iter().position(|&index| pipeline.stages[index].name == stage);
    let at = at.unwrap_or(selection.len() - 1);
    let (spec, status) = (&pipeline.stages[selection[at]], &statuses[at]);
    let digests = digests_of(spec, &selection, &statuses);
    let reasons = reasons(&planner, spec, status, &digests)?;
    let mut causes = Vec::new();
    // Goes back through stages that would be built; stages before a reused one do not matter.
    let mut to_explain: BTreeSet<usize> = BTreeSet::new();
    if !reasons.is_empty() {
        to_explain.extend(spec.reads());
        for (&index, status) in selection.iter().zip(&statuses).take(at).rev() {
            if !to_explain.contains(&index) {
                continue;
            }
            let spec = &pipeline.stages[index];
            let digests = digests_of(spec, &selection, &statuses);
            let mut own = self::reasons(&planner, spec, status, &digests)?;
            if !own.is_empty() {
                to_explain.extend(spec.reads());
            }
            own.retain(|reason| !matches!(reason, Staleness::InputChanged { .. }));
            if !own.is_empty() {
                causes.push((spec.name.clone(), own));
            }
        }
        causes.reverse();
    }
    let key = status.action.as_ref().map(|(_, key)| *key);
    let same = match &key {
        Some(key) => planner.last_run_with(key)?,
        None => None,
    };
    let is_same = same.is_some();
    let last = match same {
        Some(same) => Some(same),
        None => planner.last_run_of(spec)?,
    };
    let names = spec.needs.iter().map(|&need| pipeline.stages[need].name.clone());
    Ok(Explanation {
        report: report(spec, status),
        key,
        causes,
        reasons,
        inputs: names.zip(digests).collect(),
        last: last.map(|(run, stage)| LastRun {
            is_same,
            created: run.created.clone(),
            key: stage.key,
            artifact: stage.artifact,
        }),
    })
}
