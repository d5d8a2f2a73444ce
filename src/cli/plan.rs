//! `deaflow plan`: what `run` would build and why.

use serde_json::json;

use super::arguments::PipelineArguments;
use super::error::CliError;
use super::output::{Exit, Output};
use super::{run, table};
use crate::orchestrator::{Outcome, plan};
use crate::store::Store;

pub fn execute(arguments: &PipelineArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = run::load(arguments)?;
    // A plan writes nothing: where there is no store yet, an empty one elsewhere stands in for it.
    let folder = arguments.store.folder();
    let scratch = (!folder.exists()).then(tempfile::tempdir).transpose();
    let scratch = scratch.map_err(|e| CliError::failure(format!("cannot make a temporary folder: {e}")))?;
    let store = Store::open(scratch.as_ref().map_or(&folder, |s| s.path()))?;
    let stages = plan(&pipeline, &store, arguments.until.as_deref())?;
    if output.is_json() {
        output.document(&json!({ "pipeline": pipeline.name, "store": folder, "stages": stages }))?;
        return Ok(Exit::Done);
    }
    let stale = stages.iter().filter(|stage| stage.outcome == Outcome::Stale).count();
    let summary = match stale {
        0 => "nothing to build".to_owned(),
        n => format!("{n} of {} stages to build", stages.len()),
    };
    output.text(&format!("{}\n\n{summary}", table::of_plan(&stages)))?;
    Ok(Exit::Done)
}
