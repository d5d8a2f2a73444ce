//! Past runs as documents.

use serde_json::{Value, json};

use crate::store::Run;

/// One run, as `deaflow log --json` tells it.
#[must_use]
pub fn run_document(run: &Run) -> Value {
    let stage = |name: &str, outcome: &str, digest: Option<String>| json!({ "name": name, "outcome": outcome, "digest": digest });
    let done = run
        .stages
        .iter()
        .map(|done| stage(&done.name, done.outcome.name(), Some(done.artifact.to_string())));
    let failed = run.failures.iter().map(|name| stage(name, "failed", None));
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
        "stages": done.chain(failed).collect::<Vec<_>>(),
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
