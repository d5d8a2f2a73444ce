//! Past runs as documents.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use deaflow_base::ArtifactId;
use deaflow_store::{Run, Store};

/// What collections have removed and is not here, and when.
pub struct Gone<'a> {
    store: &'a Store,
    at: BTreeMap<ArtifactId, String>,
}

impl<'a> Gone<'a> {
    /// Of a store.
    #[must_use]
    pub fn in_store(store: &'a Store) -> Self {
        let removed = store.removed().into_iter();
        let at = removed.map(|removed| (removed.digest, removed.at)).collect();
        Self { store, at }
    }

    /// When an artifact was removed; none while it is here, or where it was not removed by a collection.
    #[must_use]
    pub fn at(&self, artifact: &ArtifactId) -> Option<&str> {
        let at = self.at.get(artifact)?;
        (!self.store.has(artifact)).then_some(at.as_str())
    }
}

/// One run, as `deaflow log --json` tells it.
#[must_use]
pub fn run_document(run: &Run, removed: &Gone<'_>) -> Value {
    let done = run.stages.iter().map(|done| {
        json!({
            "name": done.name,
            "outcome": done.outcome.name(),
            "digest": done.artifact.to_string(),
            "removed": removed.at(&done.artifact),
        })
    });
    let unmade =
        |name: &String, outcome: &str| json!({ "name": name, "outcome": outcome, "digest": null, "removed": null });
    let failed = run.failures.iter().map(|name| unmade(name, "failed"));
    let stopped = run.stopped.iter().map(|name| unmade(name, "stopped"));
    let not_begun = run.not_begun.iter().map(|name| unmade(name, "skipped"));
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

/// A number or a truth value as such, and all else as it was said.
fn typed(value: &str) -> Value {
    match serde_json::from_str(value) {
        Ok(plain @ (Value::Number(_) | Value::Bool(_))) => plain,
        _ => json!(value),
    }
}
