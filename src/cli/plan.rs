//! `deaflow plan`: what `run` would build, why, and what that would take.

use clap::Args;

use super::arguments::PipelineArguments;
use super::error::CliError;
use super::examples::examples;
use super::output::{Exit, Output};
use super::text::Text;
use super::tone::Tone;
use super::{run, table};
use deaflow_orchestrator::{Environment, Pipeline, plan, plan_document, plan_warnings, price_total};

/// Say what `run` would build, why, and what it would take; build nothing
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow plan pipeline.yaml", "deaflow plan pipeline.yaml --set scene.drive.voltage=\"5 kV\""))]
pub struct PlanArguments {
    #[command(flatten)]
    of: PipelineArguments,
}

pub fn execute(arguments: &PlanArguments, output: &Output) -> Result<Exit, CliError> {
    of_pipeline(&run::load(&arguments.of)?, &arguments.of, output)
}

/// Says what a run of a pipeline would build.
pub fn of_pipeline(pipeline: &Pipeline, arguments: &PipelineArguments, output: &Output) -> Result<Exit, CliError> {
    let folder = arguments.store_folder();
    let (_scratch, store) = run::store_to_look_into(&folder)?;
    let reading = arguments.read(store, output)?;
    let stages = plan(
        pipeline,
        reading.store(),
        arguments.until.as_deref(),
        &Environment::system(),
    )?;
    let warnings = plan_warnings(pipeline, &stages, reading.store())?;
    reading.end(output, true);
    if output.is_json() {
        output.document(&plan_document(pipeline, &folder, &stages, &warnings))?;
        return Ok(Exit::Done);
    }
    let total = price_total(&stages);
    let summary = match total.stale {
        0 => "nothing to build".to_owned(),
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
            "time: a stage's part of the time of the run; of stages that are built at once each is at work for longer",
        );
    }
    output.text(text)?;
    for warning in warnings {
        output.complain(&format!("warning: {warning}"));
    }
    Ok(Exit::Done)
}
