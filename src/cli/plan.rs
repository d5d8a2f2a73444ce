//! `deaflow plan`: the stages that `run` would build, why, and at what cost.

use clap::Args;

use super::arguments::PipelineArguments;
use super::pipeline::{load, store_to_read};
use super::text::Text;
use super::tone::Tone;
use super::upstream::StoreAccess;
use super::{CliError, Exit, Output, table};
use deaflow_orchestrator::{Environment, Pipeline, plan, plan_document, plan_warnings, price_total};
use deaflow_store::Store;

/// Show what `run` would build, why, and the estimated cost; build nothing
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow plan pipeline.yaml",
    "deaflow plan pipeline.yaml --set scene.drive.voltage=\"5 kV\"",
))]
pub struct PlanArguments {
    #[command(flatten)]
    of: PipelineArguments,
}

pub fn execute(arguments: &PlanArguments, output: &Output) -> Result<Exit, CliError> {
    print(&load(&arguments.of)?, &arguments.of, output)
}

/// Prints what a run of a pipeline would build.
///
/// # Errors
/// When the store cannot be read.
pub fn print(pipeline: &Pipeline, arguments: &PipelineArguments, output: &Output) -> Result<Exit, CliError> {
    let folder = arguments.store_folder();
    // A run would refuse it.
    Store::check_folder(&folder)?;
    let (_scratch, store) = store_to_read(&folder)?;
    let access = StoreAccess::open(store, arguments, output)?;
    let stages = plan(
        pipeline,
        access.store(),
        arguments.until.as_deref(),
        &Environment::system(),
    )?;
    let warnings = plan_warnings(pipeline, &stages, access.store())?;
    access.end(output, true);
    if output.is_json() {
        output.document(&plan_document(pipeline, &folder, &stages, &warnings))?;
        return Ok(Exit::Done);
    }
    let total = price_total(&stages);
    let summary = match total.stale {
        0 => "up to date: nothing to build".to_owned(),
        n => format!(
            "{n} of {} stages to build: {}",
            stages.len(),
            table::price(total.price.as_ref(), total.unpriced)
        ),
    };
    let mut text = Text::of(table::of_plan(&stages));
    text.line("").line(summary);
    if total.price.is_some() && total.stale > 1 && rayon::current_num_threads() > 1 {
        text.toned(
            Tone::Dim,
            "time: share of the time of the run; stages that are built in parallel each take longer",
        );
    }
    output.text(text)?;
    warnings.iter().for_each(|warning| output.warn(warning));
    Ok(Exit::Done)
}
