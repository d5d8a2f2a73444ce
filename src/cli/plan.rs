//! `deaflow plan`: what `run` would build, why, and what that would take.

use serde_json::json;

use super::arguments::PipelineArguments;
use super::error::CliError;
use super::output::{Exit, Output};
use super::{run, table};
use crate::orchestrator::{Environment, Outcome, Price, StageReport, plan};

pub fn execute(arguments: &PipelineArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = run::load(arguments)?;
    let (_scratch, store) = run::store_to_look_into(&arguments.store)?;
    let store = arguments.trust(store);
    let stages = plan(&pipeline, &store, arguments.until.as_deref(), &Environment::system())?;
    let stale: Vec<&StageReport> = stages.iter().filter(|stage| stage.outcome == Outcome::Stale).collect();
    let price = stale.iter().filter_map(|stage| stage.price).reduce(Price::plus);
    let unpriced = stale.iter().filter(|stage| stage.price.is_none()).count();
    if output.is_json() {
        output.document(&json!({
            "pipeline": pipeline.name,
            "store": arguments.store.folder(),
            "stages": stages,
            "price": price,
            "unpriced": unpriced,
        }))?;
        return Ok(Exit::Done);
    }
    let summary = match stale.len() {
        0 => "nothing to build".to_owned(),
        n => format!(
            "{n} of {} stages to build: {}",
            stages.len(),
            table::price(price.as_ref(), unpriced)
        ),
    };
    output.text(&format!("{}\n\n{summary}", table::of_plan(&stages)))?;
    Ok(Exit::Done)
}
