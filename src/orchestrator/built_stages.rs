//! The stages of a pipeline that are built in a store, for export and upload.

use std::collections::BTreeMap;

use super::planner::{Planner, StageState};
use super::spec::Pipeline;
use super::staleness::Staleness;
use deaflow_base::ArtifactId;
use deaflow_store::{LockFile, LockedStage, Record, Store, StoreError};

/// A stage that is built.
pub struct BuiltStage {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: &'static str,
    /// Names of the stages that it reads.
    pub needs: Vec<String>,
    /// Its record.
    pub record: Record,
}

/// The built stages of a pipeline.
pub struct BuiltStages {
    /// The built stages, in topological order.
    pub stages: Vec<BuiltStage>,
    /// Names of the other stages.
    pub missing: Vec<String>,
    /// The recorded artifacts of some of these, which are missing or damaged or have such chunks.
    pub lost: BTreeMap<String, ArtifactId>,
}

/// Determines which stages of a pipeline are built.
///
/// # Errors
/// If the store cannot be read.
pub fn built_stages(pipeline: &Pipeline, store: &Store) -> Result<BuiltStages, StoreError> {
    let selection: Vec<usize> = (0..pipeline.stages.len()).collect();
    let statuses = Planner::new(pipeline, store).statuses(&selection)?;
    let mut built = BuiltStages {
        stages: Vec::new(),
        missing: Vec::new(),
        lost: BTreeMap::new(),
    };
    for (spec, status) in pipeline.stages.iter().zip(statuses) {
        let record = match status.state {
            StageState::Fresh { record, .. } => record,
            StageState::Stale { why, expected, .. } => {
                if let (Staleness::ArtifactMissing | Staleness::ArtifactDamaged, Some(artifact)) = (why, expected) {
                    built.lost.insert(spec.name.clone(), artifact);
                }
                built.missing.push(spec.name.clone());
                continue;
            }
        };
        let needs = spec.needs.iter().map(|&need| pipeline.stages[need].name.clone());
        built.stages.push(BuiltStage {
            name: spec.name.clone(),
            kind: spec.kind.name(),
            needs: needs.collect(),
            record: *record,
        });
    }
    Ok(built)
}

impl BuiltStages {
    /// Returns the lock file of the built stages, with the target of the newest.
    #[must_use]
    pub fn lock_file(&self, pipeline: &str) -> LockFile {
        let last = self
            .stages
            .iter()
            .max_by(|a, b| a.record.created.cmp(&b.record.created));
        let locked = |stage: &BuiltStage| LockedStage {
            key: stage.record.key,
            artifact: stage.record.artifact,
        };
        LockFile {
            pipeline: pipeline.to_owned(),
            target: last.map_or_else(String::new, |stage| stage.record.target.clone()),
            stages: self
                .stages
                .iter()
                .map(|stage| (stage.name.clone(), locked(stage)))
                .collect(),
        }
    }
}
