//! Runs that are begun from the page, where that is allowed.

use std::collections::BTreeMap;
use std::process::Command;

use serde::Deserialize;
use serde_json::Value;

use super::pipelines::{numbered, overrides};
use crate::http::{Answer, Method, Refusal, Request};
use crate::state::ServedState;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RunRequest {
    #[serde(default)]
    pipeline: Value,
    #[serde(default)]
    set: BTreeMap<String, Value>,
    #[serde(default)]
    until: Option<String>,
}

/// `POST` begins a run, `GET` tells of it, `DELETE` ends it.
///
/// # Errors
/// When runs are not allowed, one goes on already, or it cannot begin.
pub fn run(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    if request.method != Method::Get && !state.may_run() {
        return Err(Refusal::new(403, "nothing is run from here").help("`deaflow serve --allow-run` allows it"));
    }
    match request.method {
        Method::Get => {}
        Method::Post => begin(state, &request.json()?)?,
        Method::Delete => state.runner.stop(),
    }
    Ok(state.runner.told().into())
}

fn begin(state: &ServedState, asked: &RunRequest) -> Result<(), Refusal> {
    let path = numbered(state, &asked.pipeline)?;
    // Looked through for names of files; the process reads them again.
    overrides(&asked.set)?;
    let failed = |error: std::io::Error| Refusal::new(503, format!("the run cannot begin: {error}"));
    let mut command = Command::new(std::env::current_exe().map_err(failed)?);
    command.arg("run").arg(&path).arg("--store").arg(state.store_folder());
    command.args(["--progress", "json"]);
    let text = |value: &Value| match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    let set: BTreeMap<String, String> = asked
        .set
        .iter()
        .map(|(path, value)| (path.clone(), text(value)))
        .collect();
    for (path, value) in &set {
        command.arg(format!("--set={path}={value}"));
    }
    if let Some(until) = &asked.until {
        command.arg(format!("--until={until}"));
    }
    match state
        .runner
        .begin(path.display().to_string(), set, command)
        .map_err(failed)?
    {
        true => Ok(()),
        false => Err(Refusal::new(409, "a run goes on already").help("stop it first, or wait for it")),
    }
}
