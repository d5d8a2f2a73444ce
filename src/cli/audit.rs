//! `deaflow audit`: whether a dataset, ours or from elsewhere, is what it says it is.

mod report;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;

use super::arguments::{SetArguments, StoreArguments, accuracy};
use super::error::CliError;
use super::examples::examples;
use super::locate;
use super::output::{Exit, Output};
use super::progress::{Bar, RunProgress, Shown};
use super::{run, write};
use deaflow_base::{ArtifactId, Override, Quantity};
use deaflow_content::{AttributeError, Audit};
use deaflow_orchestrator::{Environment, Pipeline, RunOptions, Staleness, plan, run as run_pipeline};
use deaflow_stage::audit::{self, Audited, Finding, Request, Severity};
use deaflow_store::{Artifact, Command, Store, StoreError};
use report::Answer;

/// Check a dataset: provenance, values, symmetries, leaks, and labels by simulation
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow audit pipeline.yaml:solved", "deaflow audit measured.h5 --scene scene.yaml --samples all"))]
pub struct AuditArguments {
    /// A stage, PIPELINE.yaml:STAGE, or a file in the layout of `deaflow solve`, which takes --scene
    #[arg(value_name = "PIPELINE:STAGE|FILE.h5")]
    pub dataset: String,
    /// The scene of the file, or a pipeline whose scene is meant; a YAML file
    #[arg(long, value_name = "SCENE", conflicts_with = "sets")]
    pub scene: Option<PathBuf>,
    /// Random rows to simulate on a finer mesh too, or all
    #[arg(long, value_name = "N|all", default_value = "32", value_parser = samples)]
    pub samples: Samples,
    /// Seed of the random choice
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=i64::MAX as u64))]
    pub seed: u64,
    /// The error that labels may have, as in "0.01 mm" [default: what the dataset declares]
    #[arg(long, value_name = "LENGTH", value_parser = accuracy)]
    pub accuracy: Option<Quantity>,
    /// Folder for a report: audit.html, with its figures in it
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub store: StoreArguments,
    #[command(flatten)]
    pub set: SetArguments,
}

/// A number of rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Samples {
    /// So many at random.
    Random(u64),
    /// Every one.
    All,
}

fn samples(text: &str) -> Result<Samples, String> {
    if text == "all" {
        return Ok(Samples::All);
    }
    let number = text.parse::<u64>().ok().filter(|n| *n <= 100_000_000);
    number
        .map(Samples::Random)
        .ok_or_else(|| "allowed: 0 to 100000000, or all".to_owned())
}

pub fn execute(arguments: &AuditArguments, output: &Output) -> Result<Exit, CliError> {
    if let Some(folder) = &arguments.output {
        write::folder(folder)?;
        // What is in the way has to be known before minutes of work, not after.
        for name in ["audit.html", "audit.png"] {
            write::check_file(&folder.join(name))?;
        }
    }
    let answer = match (locate::split(&arguments.dataset), &arguments.scene) {
        (Some((pipeline, stage)), None) => of_stage(arguments, (Path::new(pipeline), stage), output)?,
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
        output.text(answer.text(&files))?;
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
    let audited = audit::audit_file(file, scene, &request, &bar)?;
    bar.clear();
    let mut answer = Answer::of(&arguments.dataset, audited).map_err(unreadable)?;
    answer.seconds = Some(start.elapsed().as_secs_f64());
    Ok(answer.with_rows_of(Audited::File(file)))
}

fn unreadable(error: AttributeError) -> CliError {
    CliError::failure(format!("this is no audit: {error}"))
}

/// The dataset of a stage as the pipeline is now. What is known without it is told even where it is not there any more.
fn of_stage(arguments: &AuditArguments, (path, name): (&Path, &str), output: &Output) -> Result<Answer, CliError> {
    let mut sets = arguments.set.overrides()?;
    let pipeline = run::load_file(path, &sets, arguments.set.many)?;
    check_kind(&pipeline, name)?;
    let store = locate::existing_store(&arguments.store.folder_of(path))?;
    let artifact = match current(&pipeline, &store, name)? {
        Ok(artifact) => artifact,
        Err(finding) => return Ok(Answer::only(&arguments.dataset, finding)),
    };
    let lineage = audit::trace(&store, &artifact)?;
    // The name of a stage of a sweep has letters that no path of a field has.
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
    let own: String = format!("audit-of-{name}").chars().map(plain).take(60).collect();
    sets.push(Override::parse(&format!(
        "stages.{own}={}",
        stage_text(arguments, name)
    ))?);
    let pipeline = run::load_file(path, &sets, arguments.set.many)?;
    let progress = RunProgress::new(Shown::Bars, output.beside());
    let listener = |event: &_| progress.tell(event);
    let options = RunOptions {
        until: Some(&own),
        // What is missing before it is what an audit is to tell.
        only: true,
        command: Command::Audit,
        ..RunOptions::default()
    };
    let outcome = run_pipeline(&pipeline, &store, &options, &Environment::system(), &listener)?;
    if let Some(failure) = outcome.failures.into_iter().next() {
        return Err(CliError::from(failure.error).of_stage(&failure.stage));
    }
    let digest = outcome.stages.last().and_then(|stage| stage.digest);
    let digest = digest.ok_or_else(|| CliError::failure("the audit has made no artifact"))?;
    let audited = store.artifact(&digest)?;
    let mut answer = Answer::of(&arguments.dataset, Audit::read(&audited)?).map_err(unreadable)?;
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
    format!("{{ kind: audit, needs: [{name:?}], samples: {samples}, seed: {seed}, fail_on: never{accuracy} }}")
}

fn check_kind(pipeline: &Pipeline, name: &str) -> Result<(), CliError> {
    pipeline.selection(Some(name))?;
    if let Some(sweep) = pipeline.sweep(name) {
        return Err(locate::several(&pipeline.path, name, &sweep.stages));
    }
    let kind = pipeline.stage(name).map_or("", |stage| stage.kind.name());
    if audit::AUDITED.contains(&kind) {
        return Ok(());
    }
    let fitting = |spec: &&deaflow_orchestrator::StageSpec| audit::AUDITED.contains(&spec.kind.name());
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
            let file = pipeline.file();
            let mut own = store.runs_of(store.runs()?, &file, &pipeline.name);
            let built = own.find(|run| !run.as_ref().is_ok_and(|run| run.stage(name).is_none()));
            if built.transpose()?.is_none() {
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

fn verified(store: &Store, digest: &ArtifactId) -> Result<Artifact, StoreError> {
    let artifact = store.artifact(digest)?;
    artifact.chunks()?;
    Ok(artifact)
}
