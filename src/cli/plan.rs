//! `deaflow plan`: what `run` would build, why, and what that would take.

use clap::Args;
use serde_json::json;

use super::arguments::PipelineArguments;
use super::error::CliError;
use super::output::{Exit, Output};
use super::{run, table};
use crate::orchestrator::{Bill, Environment, Outcome, plan};

/// Say what `run` would build, why, and what it would take; build nothing
#[derive(Debug, Args)]
pub struct PlanArguments {
    #[command(flatten)]
    of: PipelineArguments,
}

pub fn execute(arguments: &PlanArguments, output: &Output) -> Result<Exit, CliError> {
    let arguments = &arguments.of;
    let pipeline = run::load(arguments)?;
    let (_scratch, store) = run::store_to_look_into(&arguments.store)?;
    let reading = arguments.read(store, output)?;
    let stages = plan(
        &pipeline,
        reading.store(),
        arguments.until.as_deref(),
        &Environment::system(),
    )?;
    reading.end(output, true);
    let stale = stages.iter().filter(|stage| stage.outcome == Outcome::Stale);
    let bill = Bill::of(stale.map(|stage| stage.price));
    if output.is_json() {
        output.document(&json!({
            "pipeline": pipeline.name,
            "store": arguments.store.folder(),
            "stages": stages,
            "price": bill.price,
            "unpriced": bill.unpriced,
        }))?;
        return Ok(Exit::Done);
    }
    let summary = match bill.stale {
        0 => "nothing to build".to_owned(),
        n => format!(
            "{n} of {} stages to build: {}",
            stages.len(),
            table::price(bill.price.as_ref(), bill.unpriced)
        ),
    };
    output.text(&format!("{}\n\n{summary}", table::of_plan(&stages)))?;
    Ok(Exit::Done)
}
