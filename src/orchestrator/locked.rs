//! Compares a pipeline with its lock file: the keys of all stages before any work, and the artifact of each stage after
//! it.
//!
//! Keys are computed from recipe, parameters and the digests of inputs. The lock file has those digests, so all keys
//! are known before anything is built.

use super::lock_difference::LockDifference;
use super::spec::{Pipeline, StageSpec};
use super::staleness::{Current, Staleness};
use deaflow_base::ArtifactId;
use deaflow_store::{Action, LockFile, LockedStage, Record, Store, StoreError};

/// Returns all differences that are visible before any work. `selection` has the indices of the stages to compare.
///
/// # Errors
/// If the store cannot be read.
pub fn differences(
    pipeline: &Pipeline,
    selection: &[usize],
    store: &Store,
    lock: &LockFile,
) -> Result<Vec<LockDifference>, StoreError> {
    let dropped = lock.stages.keys().filter(|name| pipeline.stage(name).is_none());
    let mut found: Vec<LockDifference> = dropped.map(|name| LockDifference::Dropped(name.clone())).collect();
    for &index in selection {
        let spec = &pipeline.stages[index];
        match lock.stages.get(&spec.name) {
            None => found.push(LockDifference::Added(spec.name.clone())),
            Some(locked) => found.extend(other_key(pipeline, spec, store, lock, locked)?),
        }
    }
    Ok(found)
}

/// Returns the difference in the key of a stage, assuming the inputs of the lock file.
fn other_key(
    pipeline: &Pipeline,
    spec: &StageSpec,
    store: &Store,
    lock: &LockFile,
    locked: &LockedStage,
) -> Result<Option<LockDifference>, StoreError> {
    if let Some(from) = &spec.scene_from
        && let Some(made) = lock.stages.get(&pipeline.stages[from.index].name)
    {
        let maker = pipeline.stages[from.index].kind;
        from.read(spec.kind, maker, &made.artifact, &|| store.artifact(&made.artifact));
    }
    if spec.unknown_scene().is_some() {
        // Its artifact is compared when it is built.
        return Ok(None);
    }
    let needs = spec.needs.iter().map(|&need| pipeline.stages[need].name.as_str());
    let inputs: Vec<(&str, Option<ArtifactId>)> = needs
        .map(|name| (name, lock.stages.get(name).map(|stage| stage.artifact)))
        .collect();
    let digests: Vec<Option<ArtifactId>> = inputs.iter().map(|(_, digest)| *digest).collect();
    let parameters = spec.stage().parameters();
    let action = Action::of_stage(spec.kind.name(), spec.recipe(), &parameters, &digests);
    let Some(key) = action.map(|action| action.key()).transpose()? else {
        // An input is not in the lock file, which is reported for that input.
        return Ok(None);
    };
    if key == locked.key {
        return Ok(None);
    }
    let current = Current {
        recipe: spec.recipe(),
        from_scene: &spec.from_scene,
        files: &spec.files,
        kind: spec.kind,
        parameters: &parameters,
        inputs: &inputs,
    };
    let why = match store.record(&locked.key)?.record() {
        Some(then) => {
            let reasons = Staleness::all_since(&current, Some(&then), None);
            let reasons: Vec<String> = reasons.iter().map(ToString::to_string).collect();
            reasons.join("; ")
        }
        None => format!("its key is {}, not {}", key.short(), locked.key.short()),
    };
    Ok(Some(LockDifference::Key {
        stage: spec.name.clone(),
        why,
    }))
}

/// Returns the difference in the artifact of a stage.
#[must_use]
pub fn other_artifact(spec: &StageSpec, lock: &LockFile, record: &Record) -> Option<LockDifference> {
    let locked = lock.stages.get(&spec.name)?;
    if locked.artifact == record.artifact {
        return None;
    }
    let why = if lock.target == record.target {
        String::new()
    } else {
        format!(
            "; it was made on {}, the lock file on {}: the last bits can differ between processors",
            record.target, lock.target
        )
    };
    Some(LockDifference::Artifact {
        stage: spec.name.clone(),
        found: record.artifact.short(),
        locked: locked.artifact.short(),
        why,
    })
}
