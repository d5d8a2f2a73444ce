//! Runs that are started from the page, if that is allowed.

use std::collections::BTreeMap;

use super::pipelines::{BuildRequest, find_pipeline, overrides, value_text};
use crate::http::{ApiError, Method, Request, Response};
use crate::state::ServerState;
use deaflow_base::own_process;

/// `POST` starts a run, `GET` returns its state, `DELETE` stops it.
///
/// # Errors
/// If runs are not allowed, one is already running, or it cannot be started.
pub fn run(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    if request.method != Method::Get && !state.may_run() {
        return Err(ApiError::new(403, "this server may not start runs").help("start it with `--allow-run`"));
    }
    match request.method {
        Method::Get => {}
        Method::Post => start(state, &request.json()?)?,
        Method::Delete => state.runner.stop(),
    }
    Ok(state.runner.document().into())
}

fn start(state: &ServerState, run: &BuildRequest) -> Result<(), ApiError> {
    let path = find_pipeline(state, &run.pipeline)?;
    // Only checked here: the process parses the values again.
    overrides(&run.set)?;
    let failed = |error: std::io::Error| ApiError::new(503, format!("cannot start the run: {error}"));
    let mut command = own_process().map_err(failed)?;
    command.arg("run").arg(&path).arg("--store").arg(state.store_folder());
    command.args(["--progress", "json"]);
    let set = run.set.iter().map(|(path, value)| (path.clone(), value_text(value)));
    let set: BTreeMap<String, String> = set.collect();
    for (path, value) in &set {
        command.arg(format!("--set={path}={value}"));
    }
    if let Some(until) = &run.until {
        command.arg(format!("--until={until}"));
    }
    match state
        .runner
        .start(path.display().to_string(), set, command)
        .map_err(failed)?
    {
        true => Ok(()),
        false => Err(ApiError::new(409, "another run is in progress").help("stop it first, or wait for its end")),
    }
}
