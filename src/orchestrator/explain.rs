//! Why a stage would be built: everything that has changed since it was last built or reused, not only the first thing.

use std::collections::BTreeSet;

use super::event::StageReport;
use super::execute::RunError;
use super::plan::{digests_of, reasons, report};
use super::planner::Planner;
use super::spec::Pipeline;
use super::staleness::Staleness;
use deaflow_base::{ActionKey, ArtifactId};
use deaflow_store::Store;

/// All that is known of one stage.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// The stage as in a plan.
    pub report: StageReport,
    /// Its action key; unknown while an input has yet to be built.
    pub key: Option<ActionKey>,
    /// Why it is stale; empty where it is not.
    pub reasons: Vec<Staleness>,
    /// The stages that it needs, with what they made, as far as that is known.
    pub inputs: Vec<(String, Option<ArtifactId>)>,
    /// What its inputs would be built for, directly or not: each of these stages with its own reasons, in topological order.
    pub causes: Vec<(String, Vec<Staleness>)>,
    /// The last run that did the same; or else the last one that had a stage of its name.
    pub last: Option<LastRun>,
}

/// The last run that had a stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LastRun {
    /// Whether it did the same: the stage as it stands, with its parameters and inputs.
    pub is_same: bool,
    /// When it ended.
    pub created: String,
    /// The action key then.
    pub key: ActionKey,
    /// The artifact then.
    pub artifact: ArtifactId,
}

/// Explains a stage.
///
/// # Errors
/// When there is no such stage, or the store cannot be read.
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
    // From the stage back, through what would be built: what is reused hides what lies before it.
    let mut sought: BTreeSet<usize> = BTreeSet::new();
    if !reasons.is_empty() {
        sought.extend(&spec.needs);
        for (&index, status) in selection.iter().zip(&statuses).take(at).rev() {
            if !sought.contains(&index) {
                continue;
            }
            let spec = &pipeline.stages[index];
            let digests = digests_of(spec, &selection, &statuses);
            let mut own = self::reasons(&planner, spec, status, &digests)?;
            if !own.is_empty() {
                sought.extend(&spec.needs);
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
        Some(key) => planner.remembered_by(key)?,
        None => None,
    };
    let is_same = same.is_some();
    let last = match same {
        Some(same) => Some(same),
        None => planner.remembered(spec)?,
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
