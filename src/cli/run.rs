//! `deaflow run`: builds what is stale, then says what was built, what was found and where the figures are.

use std::path::Path;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::arguments::{PipelineArguments, StoreArguments};
use super::error::CliError;
use super::output::{Exit, Output};
use super::progress::{RunProgress, Shown};
use super::table;
use crate::base::Override;
use crate::orchestrator::{Environment, Pipeline, RunOptions, RunOutcome, run};
use crate::report::{
    Evaluation, Evaluators, Made, RoundsSummary, Summary, TrainingSummary, audits, by_round, draw_by_round,
    draw_figures, evaluations, evaluators, summarise, trainings, warnings,
};
use crate::stage;
use crate::stage::screening::neglected;
use crate::store::{LockFile, Store};

/// Build what is stale in a pipeline, then print what was found and where the figures are
#[derive(Debug, Args)]
pub struct RunArguments {
    #[command(flatten)]
    pub of: PipelineArguments,
    /// When a stage fails, go on with all that does not need it
    #[arg(short, long)]
    pub keep_going: bool,
    /// Write the lock file beside the pipeline: the digest of everything that was built or reused
    #[arg(long, conflicts_with_all = ["until", "sets", "locked"])]
    pub lock: bool,
    /// Hold the pipeline to its lock file: any difference is an error, found before any work wherever it can be
    #[arg(long)]
    pub locked: bool,
    /// Say nothing but warnings and errors
    #[arg(short, long)]
    pub quiet: bool,
    /// How progress is shown on stderr [default: bars on a terminal, or else plain lines]
    #[arg(long, value_enum, value_name = "HOW", conflicts_with = "quiet")]
    pub progress: Option<ProgressForm>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProgressForm {
    /// Plain lines
    Plain,
    /// One JSON document per line for everything that happens
    Json,
    /// Warnings only
    None,
}

pub fn execute(arguments: &RunArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = load(&arguments.of)?;
    let lock_path = LockFile::beside(&pipeline.path);
    let lock = arguments.locked.then(|| read_lock(&lock_path)).transpose()?;
    let store = arguments.of.trust(Store::open(&arguments.of.store.folder())?);
    let progress = RunProgress::new(shown(arguments));
    let listener = |event: &_| progress.tell(event);
    let options = RunOptions {
        until: arguments.of.until.as_deref(),
        keep_going: arguments.keep_going,
        lock: lock.as_ref(),
        only: false,
    };
    let mut outcome = run(&pipeline, &store, &options, &Environment::system(), &listener)?;
    if !outcome.failures.is_empty() {
        return failed(&mut outcome, arguments, output);
    }
    if arguments.lock {
        store.put_lock_file(&lock_path, &outcome.lock)?;
    }
    if arguments.locked
        && let Err(error) = store.remember_lock_file(&lock_path)
    {
        output.complain(&format!("warning: `gc` will not know of the lock file: {error}"));
    }
    if !output.is_json() && !arguments.quiet {
        // Before the figures: what was built is told even where they cannot be drawn.
        output.text(&table::of_run(&outcome.stages))?;
    }
    let made = made(&outcome);
    let summaries = summarise(&store, &made)?;
    let evaluations = evaluations(&store, &made)?;
    let evaluators = evaluators(&store, &made)?;
    let audits = audits(&store, &made)?;
    let trainings = trainings(&store, &made)?;
    let names: Vec<&str> = made.iter().map(|made| made.stage.as_str()).collect();
    let mut neglected = neglected(&pipeline, &names).map_err(|e| CliError::bad_input(e.to_string()))?;
    neglected.extend(warnings(&store, &made)?);
    let warnings = neglected;
    let rounds = by_round(&pipeline.rounds, &summaries);
    let mut figures = draw_figures(&store, &pipeline.name, &made)?;
    figures.extend(draw_by_round(&store, &pipeline.name, &made, &rounds, &summaries)?);
    let figures: Vec<String> = figures.iter().map(|path| path.display().to_string()).collect();
    if output.is_json() {
        let mut document = document(&outcome);
        document["pipeline"] = json!(pipeline.name);
        document["store"] = json!(store.root());
        document["results"] = json!(summaries);
        document["rounds"] = json!(rounds);
        document["evaluations"] = json!(evaluations);
        document["evaluators"] = json!(evaluators);
        document["audits"] = json!(audits);
        document["trainings"] = trainings.iter().map(|training| training.line.as_str()).collect();
        let of_trainings = trainings.iter().flat_map(|training| &training.warnings);
        document["warnings"] = warnings.iter().chain(of_trainings).map(String::as_str).collect();
        document["figures"] = json!(figures);
        output.document(&document)?;
    } else if arguments.quiet {
        warnings
            .iter()
            .for_each(|warning| output.complain(&format!("model warning: {warning}")));
        let of_trainings = trainings.iter().flat_map(|training| &training.warnings);
        of_trainings.for_each(|warning| output.complain(&format!("warning: {warning}")));
    } else {
        let told = told(&evaluators, &summaries, &rounds);
        output.text(&found(
            &outcome,
            &evaluations,
            &told,
            &audits,
            &trainings,
            &warnings,
            &figures,
        ))?;
    }
    Ok(if outcome.unstable > 0 {
        Exit::Unstable
    } else {
        Exit::Done
    })
}

fn shown(arguments: &RunArguments) -> Shown {
    match arguments.progress {
        _ if arguments.quiet => Shown::Warnings,
        Some(ProgressForm::None) => Shown::Warnings,
        Some(ProgressForm::Plain) => Shown::Lines,
        Some(ProgressForm::Json) => Shown::Json,
        None => Shown::Bars,
    }
}

fn read_lock(path: &Path) -> Result<LockFile, CliError> {
    if !path.exists() {
        return Err(CliError::bad_input(format!("there is no lock file {}", path.display()))
            .help("`deaflow run --lock` writes it"));
    }
    Ok(LockFile::read(path)?)
}

/// Everything that can be wrong with the arguments is found before a store is opened.
pub fn load(arguments: &PipelineArguments) -> Result<Pipeline, CliError> {
    let pipeline = load_file(&arguments.pipeline, &arguments.set.overrides()?)?;
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

/// What was built before and beside the failures stays, and is told of.
fn failed(outcome: &mut RunOutcome, arguments: &RunArguments, output: &Output) -> Result<Exit, CliError> {
    let failures = std::mem::take(&mut outcome.failures);
    let errors = failures
        .into_iter()
        .map(|failure| CliError::from(failure.error).of_stage(&failure.stage));
    let errors: Vec<CliError> = errors.collect();
    if output.is_json() {
        let mut document = document(outcome);
        document["error"] = errors.first().map(CliError::to_json).into();
        document["errors"] = errors.iter().map(CliError::to_json).collect();
        output.document(&document)?;
    } else if !arguments.quiet {
        output.text(&table::of_run(&outcome.stages))?;
    }
    errors.iter().for_each(|error| output.complain(&error.render(false)));
    // The exit code of the gravest failure would depend on taste: that of the first one it is.
    Ok(errors.first().map_or(Exit::Failure, CliError::exit))
}

/// What judged designs, and what came of them.
fn told(evaluators: &[Evaluators], summaries: &[Summary], rounds: &[RoundsSummary]) -> Vec<String> {
    let judged = evaluators.iter().map(ToString::to_string);
    let verified = summaries.iter().map(ToString::to_string);
    let by_round = rounds.iter().map(ToString::to_string);
    judged.chain(verified).chain(by_round).collect()
}

/// What was found, each part after an empty line.
fn found(
    outcome: &RunOutcome,
    evaluations: &[Evaluation],
    told: &[String],
    audits: &[String],
    trainings: &[TrainingSummary],
    warnings: &[String],
    figures: &[String],
) -> String {
    let mut parts = Vec::new();
    if outcome.unstable > 0 {
        let n = outcome.unstable;
        parts.push(format!(
            "{n} samples have no stable solution; their outcomes stand in the artifacts under `unstable/`"
        ));
    }
    parts.extend(evaluations.iter().map(ToString::to_string));
    parts.extend_from_slice(told);
    let lines: Vec<&str> = trainings.iter().map(|training| training.line.as_str()).collect();
    parts.extend((!lines.is_empty()).then(|| lines.join("\n")));
    let of_trainings: Vec<&str> = trainings.iter().flat_map(|t| &t.warnings).map(String::as_str).collect();
    parts.extend((!of_trainings.is_empty()).then(|| format!("warnings:\n  {}", of_trainings.join("\n  "))));
    parts.extend((!audits.is_empty()).then(|| audits.join("\n")));
    if !warnings.is_empty() {
        parts.push(format!(
            "model warnings:\n  {}",
            warnings.join("\n  ")
        ));
    }
    if !figures.is_empty() {
        parts.push(format!("figures:\n  {}", figures.join("\n  ")));
    }
    parts.iter().map(|part| format!("\n{part}\n")).collect()
}
