//! `deaflow report`: one page that tells what a pipeline found, and its designs as files.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::arguments::{SetArguments, StoreArguments, pipeline_parser};
use super::locate;
use super::neglected::neglected_effects;
use super::{CliError, Exit, Output, pipeline, write};
use deaflow_orchestrator::{Environment, plan, plan_warnings};
use deaflow_report::{PipelineHistory, StageRecord, write_report};

/// Write a report of a pipeline: a page with every design, and the designs as files
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow report pipeline.yaml -o report"))]
pub struct ReportArguments {
    /// The pipeline, a YAML file, or a folder with one alone [default: that of this folder]
    #[arg(default_value = ".", hide_default_value = true, value_parser = pipeline_parser())]
    pub pipeline: PathBuf,
    /// Folder for index.html, data/designs.csv, data/patterns/*.csv and data/masks/*.dxf
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Report this stage and what it needs [default: all stages]
    #[arg(long, value_name = "STAGE")]
    pub until: Option<String>,
    #[command(flatten)]
    pub set: SetArguments,
    /// Report what is there, and say on the page what is not built
    #[arg(long)]
    pub partial: bool,
}

pub fn execute(arguments: &ReportArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = pipeline::load_with(&arguments.pipeline, &arguments.set)?;
    pipeline.selection(arguments.until.as_deref())?;
    let store = locate::existing_store(&arguments.store.folder_of(&arguments.pipeline))?;
    let stages = plan(&pipeline, &store, arguments.until.as_deref(), &Environment::system())?;
    let mut history = PipelineHistory::of(&pipeline, &stages, &store)?;
    let names: Vec<&str> = stages.iter().map(|stage| stage.name.as_str()).collect();
    history.model_warnings = plan_warnings(&pipeline, &stages, &store)?;
    history
        .model_warnings
        .extend(neglected_effects(&pipeline, &names, &store)?);
    check(&history, arguments)?;
    // What cannot be written is found before the report is made.
    write::folder(&arguments.output)?;
    let written = write_report(&store, &history, &arguments.output)?;
    let missing: Vec<&str> = history.missing().iter().map(|stage| stage.name.as_str()).collect();
    if output.is_json() {
        output.document(&json!({
            "pipeline": history.pipeline,
            "store": store.root(),
            "page": written.page,
            "designs": written.designs,
            "patterns": written.patterns,
            "masks": written.masks,
            "not_built": missing,
            "found": written.found,
        }))?;
        return Ok(Exit::Done);
    }
    if !missing.is_empty() {
        output.warn(format_args!(
            "not built, and so not in the report: {}",
            missing.join(", ")
        ));
    }
    output.text(written.text())?;
    Ok(Exit::Done)
}

/// A report of half a pipeline is one only where that was asked for.
fn check(history: &PipelineHistory, arguments: &ReportArguments) -> Result<(), CliError> {
    let named = |stage: &&StageRecord| match &stage.why {
        Some(why) if why.starts_with("artifact") || why.starts_with("removed") => format!("{} ({why})", stage.name),
        _ => stage.name.clone(),
    };
    let missing: Vec<String> = history.missing().iter().map(named).collect();
    let (of, all) = (missing.len(), history.stages.len());
    if missing.is_empty() || (arguments.partial && of < all) {
        return Ok(());
    }
    let until = arguments
        .until
        .as_ref()
        .map_or_else(String::new, |stage| format!(" --until {stage}"));
    let sets: String = arguments.set.sets.iter().map(|set| format!(" --set '{set}'")).collect();
    let build = format!("build them: deaflow run {}{until}{sets}", arguments.pipeline.display());
    let path = arguments.pipeline.display();
    let message = match of == all {
        true if missing.iter().any(|name| name.contains("removed by gc")) => {
            format!("no stage of {path} is built as it stands now: {}", missing.join(", "))
        }
        true => format!("no stage of {path} is built as it stands now"),
        false => format!(
            "{of} of {all} stages of {path} are not built as they stand now: {}",
            missing.join(", ")
        ),
    };
    Err(CliError::bad_input(message).help(match of == all {
        true => build,
        false => format!("{build}; `--partial` reports what is there"),
    }))
}
