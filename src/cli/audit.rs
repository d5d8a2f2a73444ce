//! `deaflow audit`: whether a dataset, ours or from elsewhere, is what it says it is.

mod report;

use std::path::Path;
use std::time::Instant;

use super::arguments::{AuditArguments, Samples};
use super::error::CliError;
use super::locate;
use super::output::{Exit, Output};
use super::progress::{Bar, RunProgress, Shown};
use super::run;
use crate::base::Override;
use crate::orchestrator::{Environment, Pipeline, RunOptions, Staleness, plan, run as run_pipeline};
use crate::stage::audit::{self, Audited, Finding, Request, Severity};
use crate::store::{Artifact, Store, StoreError};
use report::Answer;

pub fn execute(arguments: &AuditArguments, output: &Output) -> Result<Exit, CliError> {
    if let Some(folder) = &arguments.output {
        report::check_folder(folder)?;
    }
    let answer = match (locate::split(&arguments.dataset), &arguments.scene) {
        (Some((pipeline, stage)), None) => of_stage(arguments, Path::new(pipeline), stage)?,
        (None, Some(scene)) => of_file(arguments, scene)?,
        (Some(_), Some(_)) => {
            return Err(CliError::bad_input(
                "--scene is for files: a pipeline has its own scene",
            ));
        }
        (None, None) => {
            return Err(CliError::bad_input(format!(
                "{:?} is no PIPELINE.yaml:STAGE, and a file needs a scene",
                arguments.dataset
            ))
            .help("name the scene of a file: deaflow audit FILE.h5 --scene SCENE.yaml"));
        }
    };
    let files = match &arguments.output {
        Some(folder) => answer.write(folder)?,
        None => Vec::new(),
    };
    if output.is_json() {
        output.document(&answer.document(&files))?;
    } else {
        output.text(&answer.text(&files))?;
    }
    let wrong = answer
        .findings
        .iter()
        .any(|finding| finding.severity == Severity::Error);
    Ok(if wrong { Exit::Findings } else { Exit::Done })
}

fn of_file(arguments: &AuditArguments, scene: &Path) -> Result<Answer, CliError> {
    let request = Request {
        samples: match arguments.samples {
            Samples::Random(samples) => Some(samples),
            Samples::All => None,
        },
        seed: arguments.seed,
        accuracy: arguments.accuracy,
    };
    let file = Path::new(&arguments.dataset);
    let (bar, start) = (Bar::new("audit", "percent", 100), Instant::now());
    let object = audit::audit_file(file, scene, &request, &bar)?;
    bar.finish("done");
    let mut answer = Answer::of(&arguments.dataset, object).map_err(CliError::failure)?;
    answer.seconds = Some(start.elapsed().as_secs_f64());
    Ok(answer.with_rows_of(Audited::File(file)))
}

/// The dataset of a stage as the pipeline is now. What is known without it is told even where it is not there any more.
fn of_stage(arguments: &AuditArguments, path: &Path, name: &str) -> Result<Answer, CliError> {
    let mut sets = arguments.overrides()?;
    let pipeline = run::load_file(path, &sets)?;
    check_kind(&pipeline, name)?;
    let store = locate::existing_store(&arguments.store.folder())?;
    let artifact = match current(&pipeline, &store, name)? {
        Ok(artifact) => artifact,
        Err(finding) => return Ok(Answer::only(&arguments.dataset, finding)),
    };
    let lineage = audit::trace(&store, &artifact)?;
    let own = format!("audit-of-{name}");
    sets.push(Override::parse(&format!(
        "stages.{own}={}",
        stage_text(arguments, name)
    ))?);
    let pipeline = run::load_file(path, &sets)?;
    let progress = RunProgress::new(Shown::Bars);
    let listener = |event: &_| progress.tell(event);
    let options = RunOptions {
        until: Some(&own),
        // What is missing before it is what an audit is to tell.
        only: true,
        ..RunOptions::default()
    };
    let outcome = run_pipeline(&pipeline, &store, &options, &Environment::system(), &listener)?;
    if let Some(failure) = outcome.failures.into_iter().next() {
        return Err(CliError::from(failure.error).of_stage(&failure.stage));
    }
    let digest = outcome.stages.last().and_then(|stage| stage.digest);
    let digest = digest.ok_or_else(|| CliError::failure("the audit has made no artifact"))?;
    let audited = store.artifact(&digest)?;
    let mut answer = Answer::of(&arguments.dataset, audited.object()?).map_err(CliError::failure)?;
    answer.seconds = audited.measurements()?.first().map(|(_, seconds)| *seconds);
    answer.digest = Some(digest);
    answer.add(&lineage);
    Ok(answer.with_rows_of(Audited::Artifact(&artifact)))
}

/// The audit as a stage of the pipeline, so that it is cached like any other.
fn stage_text(arguments: &AuditArguments, name: &str) -> String {
    let samples = match arguments.samples {
        Samples::Random(samples) => samples.to_string(),
        Samples::All => "all".to_owned(),
    };
    let accuracy = arguments
        .accuracy
        .map_or(String::new(), |mm| format!(", accuracy: {mm}"));
    let seed = arguments.seed;
    format!("{{ kind: audit, needs: [{name}], samples: {samples}, seed: {seed}, fail_on: never{accuracy} }}")
}

fn check_kind(pipeline: &Pipeline, name: &str) -> Result<(), CliError> {
    pipeline.selection(Some(name))?;
    let kind = pipeline.stage(name).map_or("", |stage| stage.kind.name());
    if audit::AUDITED.contains(&kind) {
        return Ok(());
    }
    let fitting = |spec: &&crate::orchestrator::StageSpec| audit::AUDITED.contains(&spec.kind.name());
    let fitting: Vec<&str> = pipeline
        .stages
        .iter()
        .filter(fitting)
        .map(|s| s.name.as_str())
        .collect();
    Err(
        CliError::bad_input(format!("stage `{name}` is of the kind `{kind}`, and holds no dataset"))
            .help(format!("stages that hold one: {}", fitting.join(", "))),
    )
}

/// The artifact of a stage, every byte of it verified, or why it is not what the pipeline would make now.
fn current(pipeline: &Pipeline, store: &Store, name: &str) -> Result<Result<Artifact, Finding>, CliError> {
    let stages = plan(pipeline, store, Some(name), &Environment::system())?;
    let stage = stages.iter().find(|stage| stage.name == name);
    let Some(stage) = stage else {
        return Err(CliError::failure(format!("stage `{name}` was not looked at")));
    };
    let finding = |check: &str, message: String| Ok(Err(Finding::whole(check, Severity::Error, message)));
    match (&stage.staleness, stage.digest) {
        (None, Some(digest)) => match verified(store, &digest) {
            Ok(artifact) => Ok(Ok(artifact)),
            Err(error) if error.is_damage() => finding("integrity", error.to_string()),
            Err(error) => Err(error.into()),
        },
        (Some(why @ (Staleness::ArtifactMissing | Staleness::ArtifactDamaged)), _) => {
            finding("integrity", format!("the dataset in the store is not whole: {why}"))
        }
        (why, _) => {
            let runs = store.runs()?;
            let built = runs
                .iter()
                .any(|run| run.pipeline == pipeline.name && run.stage(name).is_some());
            if !built {
                let path = pipeline.path.display();
                return Err(CliError::bad_input(format!("stage `{name}` of {path} is not built"))
                    .help(format!("build it: deaflow run {path} --until {name}")));
            }
            let why = why.as_ref().map_or_else(String::new, |why| format!(" ({why})"));
            let message =
                format!("the dataset in the store is not what the pipeline would make now{why}: run it first");
            finding("stale", message)
        }
    }
}

fn verified(store: &Store, digest: &crate::base::Digest) -> Result<Artifact, StoreError> {
    let artifact = store.artifact(digest)?;
    artifact.chunks()?;
    Ok(artifact)
}
