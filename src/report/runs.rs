//! Past runs as JSON documents.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use deaflow_base::ArtifactId;
use deaflow_store::{Run, Store};

/// The artifacts that `gc` has removed from a store, with the times.
pub struct RemovedArtifacts<'a> {
    store: &'a Store,
    at: BTreeMap<ArtifactId, String>,
}

impl<'a> RemovedArtifacts<'a> {
    /// Reads the list of a store.
    #[must_use]
    pub fn of(store: &'a Store) -> Self {
        let removed = store.removed().into_iter();
        let at = removed.map(|removed| (removed.digest, removed.at)).collect();
        Self { store, at }
    }

    /// Returns when an artifact was removed; `None` if it exists, or was not removed by `gc`.
    #[must_use]
    pub fn at(&self, artifact: &ArtifactId) -> Option<&str> {
        let at = self.at.get(artifact)?;
        (!self.store.has(artifact)).then_some(at.as_str())
    }
}

/// Returns a run as in `deaflow log --json`.
#[must_use]
pub fn run_document(run: &Run, removed: &RemovedArtifacts<'_>) -> Value {
    let done = run.stages.iter().map(|done| {
        json!({
            "name": done.name,
            "outcome": done.outcome.name(),
            "digest": done.artifact.to_string(),
            "removed": removed.at(&done.artifact),
        })
    });
    let without_artifact =
        |name: &String, outcome: &str| json!({ "name": name, "outcome": outcome, "digest": null, "removed": null });
    let failed = run.failures.iter().map(|name| without_artifact(name, "failed"));
    let stopped = run.stopped.iter().map(|name| without_artifact(name, "stopped"));
    let not_begun = run.not_begun.iter().map(|name| without_artifact(name, "skipped"));
    let overrides = run.overrides.iter().map(|(path, value)| (path.clone(), typed(value)));
    json!({
        "id": run.id,
        "created": run.created,
        "pipeline": run.pipeline,
        "path": run.path,
        "command": run.command.name(),
        "host": run.host,
        "version": run.version,
        "seconds": run.seconds,
        "log": run.log,
        "overrides": overrides.collect::<serde_json::Map<_, _>>(),
        "stages": done.chain(failed).chain(stopped).chain(not_begun).collect::<Vec<_>>(),
        "results": run.results,
    })
}

/// Converts numbers and booleans; other values stay texts.
fn typed(value: &str) -> Value {
    match serde_json::from_str(value) {
        Ok(plain @ (Value::Number(_) | Value::Bool(_))) => plain,
        _ => json!(value),
    }
}
