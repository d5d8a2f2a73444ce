//! `deaflow audit`: checks a dataset of a pipeline, or of another source.

mod report;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;

use super::arguments::{SetArguments, StoreArguments, accuracy, integer};
use super::locate;
use super::progress::{Bar, ProgressMode, RunProgress};
use super::{CliError, Exit, Output, pipeline, write};
use deaflow_base::{ArtifactId, Override, Quantity};
use deaflow_orchestrator::{Environment, Pipeline, RunOptions, Staleness, plan, run as run_pipeline};
use deaflow_report::set_options;
use deaflow_stage::audit::{self, Audited, Finding, Request, Severity};
use deaflow_store::{Artifact, Command, Store, StoreError};

pub use report::AuditReport;

/// Check a dataset: provenance, values, symmetries, leaks, and labels by simulation
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow audit pipeline.yaml:solved",
    "deaflow audit measured.h5 --scene scene.yaml --samples all"
))]
pub struct AuditArguments {
    /// PIPELINE.yaml:STAGE, or a file in the layout of `deaflow solve`, which needs --scene
    #[arg(value_name = "PIPELINE:STAGE|FILE.h5")]
    pub dataset: String,
    /// The scene of the file: a YAML file of a scene, or of a pipeline that has one
    #[arg(long, value_name = "SCENE", conflicts_with = "sets")]
    pub scene: Option<PathBuf>,
    /// Number of random rows to simulate on a finer mesh, or all
    #[arg(long, value_name = "N|all", default_value = "32", value_parser = samples)]
    pub samples: Samples,
    /// Seed of the random choice
    #[arg(long, value_name = "S", default_value_t = 0)]
    #[arg(value_parser = integer::<u64>(0..=i64::MAX as u64))]
    pub seed: u64,
    /// Allowed error of the labels, as in "0.01 mm" [default: as declared by the dataset]
    #[arg(long, value_name = "LENGTH", value_parser = accuracy)]
    pub accuracy: Option<Quantity>,
    /// Folder for a report: audit.html, with its figures
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
    /// Random rows.
    Random(u64),
    /// All rows.
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
        // Checked before minutes of work.
        for name in ["audit.html", "audit.png"] {
            write::check_file(&folder.join(name))?;
        }
    }
    let report = match (locate::split(&arguments.dataset), &arguments.scene) {
        (Some((pipeline, stage)), None) => of_stage(arguments, (Path::new(pipeline), stage), output)?,
        (None, Some(scene)) => of_file(arguments, scene, output)?,
        (Some(_), Some(_)) => {
            return Err(CliError::bad_input(
                "--scene cannot be used: the pipeline has its own scene",
            ));
        }
        (None, None) => {
            return Err(
                CliError::bad_input(format!("{:?} is not PIPELINE.yaml:STAGE", arguments.dataset))
                    .help("a file needs a scene: deaflow audit FILE.h5 --scene SCENE.yaml"),
            );
        }
    };
    let files = match &arguments.output {
        Some(folder) => report.write(folder, output)?,
        None => Vec::new(),
    };
    output.result(|| report.document(&files), || report.text(&files))?;
    let mut findings = report.findings.iter();
    Ok(match findings.any(|finding| finding.severity == Severity::Error) {
        true => Exit::Findings,
        false => Exit::Done,
    })
}

fn of_file(arguments: &AuditArguments, scene: &Path, output: &Output) -> Result<AuditReport, CliError> {
    let request = Request {
        samples: match arguments.samples {
            Samples::Random(samples) => Some(samples),
            Samples::All => None,
        },
        seed: arguments.seed,
        accuracy: arguments.accuracy,
    };
    let file = Path::new(&arguments.dataset);
    let scene = pipeline::read_scene(scene, output)?;
    let (bar, start) = (Bar::new("audit", "percent", 100), Instant::now());
    let audited = audit::audit_file(file, scene, &request, &bar)?;
    bar.clear();
    let mut report = AuditReport::new(&arguments.dataset, audited)?;
    report.seconds = Some(start.elapsed().as_secs_f64());
    Ok(report.with_rows_of(Audited::File(file)))
}

/// Audits the dataset of a stage of the current pipeline.
fn of_stage(arguments: &AuditArguments, (path, name): (&Path, &str), output: &Output) -> Result<AuditReport, CliError> {
    let mut sets = arguments.set.overrides()?;
    let pipeline = pipeline::load_file(path, &sets, arguments.set.many)?;
    let name = &checked_name(&pipeline, name)?;
    pipeline.bare_numbers.iter().for_each(|note| output.warn_of_units(note));
    let store = locate::existing_store(&arguments.store.folder_of(path))?;
    let artifact = match current(&pipeline, &store, name)? {
        Ok(artifact) => artifact,
        Err(finding) => return Ok(AuditReport::only(&arguments.dataset, finding)),
    };
    let lineage = audit::trace(&store, &artifact)?;
    // The name of a stage of a sweep contains characters that are not allowed in a path.
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
    let own: String = format!("audit-of-{name}").chars().map(plain).take(60).collect();
    sets.push(Override::parse(&format!(
        "stages.{own}={}",
        stage_text(arguments, name)
    ))?);
    let pipeline = pipeline::load_file(path, &sets, arguments.set.many)?;
    let progress = RunProgress::new(ProgressMode::Bars, output.errors());
    let listener = |event: &_| progress.show(event);
    let options = RunOptions {
        until: Some(&own),
        // The audit itself reports missing inputs.
        only: true,
        command: Command::Audit,
        ..RunOptions::default()
    };
    let outcome = run_pipeline(&pipeline, &store, &options, &Environment::system(), &listener)?;
    if let Some(failure) = outcome.failures.into_iter().next() {
        return Err(CliError::from(failure.error).of_stage(&failure.stage));
    }
    let digest = outcome.stages.last().and_then(|stage| stage.digest);
    let digest = digest.ok_or_else(|| CliError::failure("the audit made no artifact"))?;
    let audited = store.artifact(&digest)?;
    let mut report = AuditReport::of(&audited, &arguments.dataset)?;
    report.add(&lineage);
    Ok(report.with_rows_of(Audited::Artifact(&artifact)))
}

/// The audit as a stage of the pipeline, so that it is cached like other stages.
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

/// Returns the name of the stage, which can be the only one of a sweep; it must have a dataset.
fn checked_name(pipeline: &Pipeline, name: &str) -> Result<String, CliError> {
    pipeline.selection(Some(name))?;
    let only = match pipeline.sweep(name) {
        None => name,
        Some(sweep) => locate::only(&pipeline.path, name, &sweep.stages)?,
    };
    let kind = pipeline.stage(only).map_or("", |stage| stage.kind.name());
    if audit::AUDITED.contains(&kind) {
        return Ok(only.to_owned());
    }
    let fitting = |spec: &&deaflow_orchestrator::StageSpec| audit::AUDITED.contains(&spec.kind.name());
    let fitting: Vec<&str> = pipeline
        .stages
        .iter()
        .filter(fitting)
        .map(|s| s.name.as_str())
        .collect();
    Err(
        CliError::bad_input(format!("stage `{name}` of kind `{kind}` has no dataset"))
            .help(format!("stages with a dataset: {}", fitting.join(", "))),
    )
}

/// Returns the verified artifact of a stage, or a finding if it is not what the pipeline would build now.
fn current(pipeline: &Pipeline, store: &Store, name: &str) -> Result<Result<Artifact, Finding>, CliError> {
    let stages = plan(pipeline, store, Some(name), &Environment::system())?;
    let stage = stages.iter().find(|stage| stage.name == name);
    let Some(stage) = stage else {
        return Err(CliError::failure(format!("stage `{name}` was not planned")));
    };
    let finding = |check: &str, message: String| Ok(Err(Finding::whole(check, Severity::Error, message)));
    match (&stage.staleness, stage.digest) {
        (None, Some(digest)) => match verified(store, &digest) {
            Ok(artifact) => Ok(Ok(artifact)),
            Err(error) if error.is_damage() => finding("integrity", error.to_string()),
            Err(error) => Err(error.into()),
        },
        (Some(why @ (Staleness::ArtifactMissing | Staleness::ArtifactDamaged)), _) => {
            finding("integrity", format!("the dataset in the store is incomplete: {why}"))
        }
        (why, _) => {
            let file = pipeline.file();
            let mut own = store.runs_of(store.runs()?, &file, &pipeline.name);
            let built = own.find(|run| !run.as_ref().is_ok_and(|run| run.stage(name).is_none()));
            if built.transpose()?.is_none() {
                let path = pipeline.path.display();
                return Err(
                    CliError::bad_input(format!("stage `{name}` of {path} is not built")).help(format!(
                        "build it with: deaflow run {path} --until {name}{}",
                        set_options(&pipeline.overrides)
                    )),
                );
            }
            let why = why.as_ref().map_or_else(String::new, |why| format!(" ({why})"));
            let message = format!("the dataset in the store is stale{why}: run the pipeline first");
            finding("stale", message)
        }
    }
}

fn verified(store: &Store, digest: &ArtifactId) -> Result<Artifact, StoreError> {
    let artifact = store.artifact(digest)?;
    artifact.chunks()?;
    Ok(artifact)
}
