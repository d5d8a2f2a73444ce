//! `deaflow plan`: what `run` would build and why.

use serde_json::json;

use super::arguments::PipelineArguments;
use super::error::CliError;
use super::output::{Exit, Output};
use super::{run, table};
use crate::orchestrator::{Outcome, plan};

pub fn execute(arguments: &PipelineArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = run::load(arguments)?;
    let (_scratch, store) = run::store_to_look_into(&arguments.store)?;
    let stages = plan(&pipeline, &store, arguments.until.as_deref())?;
    if output.is_json() {
        output.document(&json!({ "pipeline": pipeline.name, "store": arguments.store.folder(), "stages": stages }))?;
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
