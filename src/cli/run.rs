//! `deaflow run`: builds what is stale, then says what was built, what was found and where the figures are.

use std::path::Path;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::arguments::{PipelineArguments, StoreArguments};
use super::error::CliError;
use super::output::{Exit, Output};
use super::progress::RunProgress;
use super::table;
use crate::base::Override;
use crate::orchestrator::{Environment, Pipeline, RunOutcome, run};
use crate::report::{Made, Summary, draw_figures, summarise, warnings};
use crate::stage;
use crate::store::Store;

pub fn execute(arguments: &PipelineArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = load(arguments)?;
    let store = Store::open(&arguments.store.folder())?;
    let progress = RunProgress::new();
    let listener = |event: &_| progress.tell(event);
    let until = arguments.until.as_deref();
    let mut outcome = run(&pipeline, &store, until, &Environment::system(), &listener)?;
    if let Some(reason) = &outcome.not_logged {
        output.complain(&format!("warning: the store does not remember this run: {reason}"));
    }
    if let Some(failure) = outcome.failure.take() {
        let name = outcome.stages.last().map_or("", |stage| stage.name.as_str());
        return failed(&outcome, CliError::from(failure).of_stage(name), output);
    }
    if !output.is_json() {
        // Before the figures: what was built is told even where they cannot be drawn.
        output.text(&table::of_run(&outcome.stages))?;
    }
    let made = made(&outcome);
    let summaries = summarise(&store, &made)?;
    let warnings = warnings(&store, &made)?;
    let figures = draw_figures(&store, &pipeline.name, &made)?;
    let figures: Vec<String> = figures.iter().map(|path| path.display().to_string()).collect();
    if output.is_json() {
        let mut document = document(&outcome);
        document["pipeline"] = json!(pipeline.name);
        document["store"] = json!(store.root());
        document["results"] = json!(summaries);
        document["warnings"] = json!(warnings);
        document["figures"] = json!(figures);
        output.document(&document)?;
    } else {
        output.text(&found(&outcome, &summaries, &warnings, &figures))?;
    }
    Ok(if outcome.unstable > 0 {
        Exit::Unstable
    } else {
        Exit::Done
    })
}

/// Everything that can be wrong with the arguments is found before a store is opened.
pub fn load(arguments: &PipelineArguments) -> Result<Pipeline, CliError> {
    let pipeline = load_file(&arguments.pipeline, &arguments.overrides()?)?;
    pipeline.selection(arguments.until.as_deref())?;
    Ok(pipeline)
}

/// A pipeline with what stands on the command line for it.
pub fn load_file(path: &Path, overrides: &[Override]) -> Result<Pipeline, CliError> {
    Ok(Pipeline::load(path, overrides, &stage::registry())?)
}

/// The store, for a command that writes nothing: where there is none yet, an empty one elsewhere stands in for it, as long
/// as its folder is held.
pub fn store_to_look_into(arguments: &StoreArguments) -> Result<(Option<TempDir>, Store), CliError> {
    let folder = arguments.folder();
    let scratch = (!folder.exists()).then(tempfile::tempdir).transpose();
    let scratch = scratch.map_err(|e| CliError::failure(format!("cannot make a temporary folder: {e}")))?;
    let store = Store::open(scratch.as_ref().map_or(&folder, |s| s.path()))?;
    Ok((scratch, store))
}

fn made(outcome: &RunOutcome) -> Vec<Made> {
    let stages = outcome.stages.iter();
    stages
        .filter_map(|stage| {
            Some(Made {
                stage: stage.name.clone(),
                kind: stage.kind.clone(),
                digest: stage.digest?,
            })
        })
        .collect()
}

fn document(outcome: &RunOutcome) -> Value {
    json!({ "stages": outcome.stages, "unstable": outcome.unstable })
}

/// What was built before the failure stays, and is told of.
fn failed(outcome: &RunOutcome, error: CliError, output: &Output) -> Result<Exit, CliError> {
    if !output.is_json() {
        output.text(&table::of_run(&outcome.stages))?;
        return Err(error);
    }
    let mut document = document(outcome);
    document["error"] = error.to_json();
    output.document(&document)?;
    output.complain(&error.render(false));
    Ok(error.exit())
}

/// What was found, each part after an empty line.
fn found(outcome: &RunOutcome, summaries: &[Summary], warnings: &[String], figures: &[String]) -> String {
    let mut parts = Vec::new();
    if outcome.unstable > 0 {
        let n = outcome.unstable;
        parts.push(format!(
            "{n} samples have no stable solution; their outcomes stand in the artifacts under `unstable/`"
        ));
    }
    parts.extend(summaries.iter().map(ToString::to_string));
    if !warnings.is_empty() {
        parts.push(format!(
            "not simulated although it matters:\n  {}",
            warnings.join("\n  ")
        ));
    }
    if !figures.is_empty() {
        parts.push(format!("figures:\n  {}", figures.join("\n  ")));
    }
    parts.iter().map(|part| format!("\n{part}\n")).collect()
}
