//! `deaflow report`: a page with the results of a pipeline, its designs as files, and the fabrication sheet of one.

mod sheet;
mod voltage_sweep;

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::arguments::{DesignArguments, SetArguments, StoreArguments, pipeline_parser};
use super::job::extend;
use super::locate;
use super::neglected::neglected_effects;
use super::progress::ProgressMode;
use super::{CliError, Exit, Output, pipeline, upstream, write};
use deaflow_orchestrator::{Environment, Pipeline, plan, plan_warnings};
use deaflow_report::{
    PipelineHistory, RunArtifacts, StageArtifact, StageRecord, set_options, shell_word, write_report,
};
use deaflow_store::{Condition, Effort, Store};
use voltage_sweep::voltage_sweep;

/// Write a report of a pipeline: a page with all designs, and the designs as files
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow report pipeline.yaml -o report",
    "deaflow report pipeline.yaml --sheet sheet.html --design centre",
))]
pub struct ReportArguments {
    /// The pipeline: a YAML file, or a folder with exactly one [default: the current folder]
    #[arg(default_value = ".", hide_default_value = true, value_parser = pipeline_parser())]
    pub pipeline: PathBuf,
    /// Folder for index.html, data/designs.csv, data/patterns/*.csv and data/masks/*.dxf
    #[arg(short, long, value_name = "DIR", required_unless_present = "sheet")]
    pub output: Option<PathBuf>,
    /// A fabrication sheet of the best design: a page of A4 with the mask at scale 1:1, what to expect, and a table for
    /// measurements
    #[arg(long, value_name = "FILE.html")]
    pub sheet: Option<PathBuf>,
    #[command(flatten)]
    pub which: DesignArguments,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Report only this stage and the stages that it needs [default: all stages]
    #[arg(long, value_name = "STAGE")]
    pub until: Option<String>,
    #[command(flatten)]
    pub set: SetArguments,
    /// Report the built stages, and list the others on the page
    #[arg(long)]
    pub partial: bool,
}

pub fn execute(arguments: &ReportArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = pipeline::load_with(&arguments.pipeline, &arguments.set)?;
    pipeline.bare_numbers.iter().for_each(|note| output.warn_of_units(note));
    pipeline.selection(arguments.until.as_deref())?;
    if let (None, Some(option)) = (&arguments.sheet, arguments.which.given()) {
        return Err(CliError::bad_input(format!("--{option} selects the design of --sheet"))
            .help("add --sheet FILE.html; the page of -o has all designs"));
    }
    check_names(arguments)?;
    let store = locate::existing_store(&arguments.store.folder_of(&arguments.pipeline))?;
    let stages = plan(&pipeline, &store, arguments.until.as_deref(), &Environment::system())?;
    let mut history = PipelineHistory::of(&pipeline, &stages, &store)?;
    history.model_warnings = plan_warnings(&pipeline, &stages, &store)?;
    let made: Vec<StageArtifact> = history.stages.iter().filter_map(made_by).collect();
    let artifacts = RunArtifacts {
        store: &store,
        file: &pipeline.file(),
        stages: &made,
        rounds: &pipeline.rounds,
    };
    check(&history, arguments, &pipeline, &store)?;
    // The design is selected, and all files are checked, before one is written.
    let sheet = arguments.sheet.as_deref();
    let sheet = sheet.map(|file| sheet::PreparedSheet::make(file, arguments, &pipeline, &artifacts, &history));
    let sheet = sheet.transpose()?;
    if let Some(folder) = &arguments.output {
        let neglected = neglected_effects(&pipeline, &artifacts, ProgressMode::Bars)?;
        history.model_warnings.extend(neglected.all());
        write::folder(folder)?;
    }
    if let Some(file) = &arguments.sheet {
        write::check_output(file, &[history.path.clone()])?;
    }
    let folder = arguments.output.as_deref();
    let report = folder
        .map(|folder| write_report(&store, &history, folder, |designs| voltage_sweep(designs, &pipeline)))
        .transpose()?;
    sheet.iter().try_for_each(sheet::PreparedSheet::write)?;
    let missing: Vec<&str> = history.missing().iter().map(|stage| stage.name.as_str()).collect();
    if !missing.is_empty() && !output.is_json() {
        output.warn(format_args!("not built and not in the report: {}", missing.join(", ")));
    }
    let document = || {
        let mut document = json!({
            "pipeline": history.pipeline,
            "store": store.root(),
            "not_built": missing,
        });
        if let Some(written) = &report {
            let files = json!({
                "page": written.page,
                "designs": written.designs,
                "patterns": written.patterns,
                "masks": written.masks,
                "found": written.found,
            });
            extend(&mut document, files);
        }
        if let Some(sheet) = &sheet {
            extend(&mut document, sheet.document());
        }
        document
    };
    let texts = || {
        report
            .iter()
            .map(|written| written.text())
            .chain(sheet.iter().map(|sheet| sheet.text()))
    };
    output.result(document, || texts().collect::<Vec<_>>().join("\n"))
}

/// Refuses names of other formats: the sheet is a web page, and the report a folder with one.
fn check_names(arguments: &ReportArguments) -> Result<(), CliError> {
    const OTHERS: [&str; 8] = ["pdf", "png", "svg", "jpg", "docx", "md", "txt", "zip"];
    let ends_with = |path: &Path, extensions: &[&str]| {
        let extension = path.extension().and_then(|extension| extension.to_str());
        extension.is_some_and(|extension| extensions.iter().any(|other| extension.eq_ignore_ascii_case(other)))
    };
    let print = "open the page in a browser and print it to a PDF file";
    if let Some(file) = &arguments.sheet
        && ends_with(file, &OTHERS)
    {
        let message = format!(
            "the sheet is a web page, and {} is the name of another format",
            file.display()
        );
        let named = file.with_extension("html");
        return Err(CliError::bad_input(message).help(format!("name it {}; {print}", named.display())));
    }
    if let Some(folder) = &arguments.output
        && !folder.is_dir()
        && (ends_with(folder, &OTHERS) || ends_with(folder, &["html", "htm"]))
    {
        let message = format!("the report is a folder, and {} is the name of a file", folder.display());
        let named = folder.with_extension("");
        return Err(CliError::bad_input(message).help(format!("use -o {}; {print}", named.display())));
    }
    Ok(())
}

fn made_by(stage: &StageRecord) -> Option<StageArtifact> {
    Some(StageArtifact {
        stage: stage.name.clone(),
        kind: stage.kind.clone(),
        digest: stage.digest?,
    })
}

/// Refuses missing stages, unless a partial report was requested.
fn check(
    history: &PipelineHistory,
    arguments: &ReportArguments,
    pipeline: &Pipeline,
    store: &Store,
) -> Result<(), CliError> {
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
    let sets = set_options(&history.overrides);
    let build = format!(
        "build them with: deaflow run {}{until}{sets}",
        arguments.pipeline.display()
    );
    let build = match pull(history, pipeline, store, arguments)? {
        Some(pull) => format!("fetch them with: {pull}; or {build}"),
        None => build,
    };
    let path = arguments.pipeline.display();
    let message = match of == all {
        true if missing.iter().any(|name| name.contains("removed by gc")) => {
            format!("no stage of {path} is up to date: {}", missing.join(", "))
        }
        true => format!("no stage of {path} is up to date"),
        false => format!(
            "{of} of {all} stages of {path} are not up to date: {}",
            missing.join(", ")
        ),
    };
    Err(CliError::bad_input(message).help(match of == all {
        true => build,
        false => format!("{build}; or report the built stages with --partial"),
    }))
}

/// Returns the command that fetches the missing stages, if the last run of the pipeline had a result that is not in
/// this store: it was on a remote.
fn pull(
    history: &PipelineHistory,
    pipeline: &Pipeline,
    store: &Store,
    arguments: &ReportArguments,
) -> Result<Option<String>, CliError> {
    let mut own = store.runs_of(store.runs()?, &pipeline.file(), &pipeline.name);
    let Some(last) = own
        .next()
        .transpose()?
        .filter(|run| run.overrides == pipeline.overrides)
    else {
        return Ok(None);
    };
    for missing in history.missing() {
        let Some(made) = last.stage(&missing.name) else {
            continue;
        };
        let is_missing = matches!(store.inspect(&made.artifact, Effort::Quick)?, Condition::Missing);
        if is_missing && store.removal_of(&made.artifact)?.is_none() {
            let option = |name: &str, value: String| format!(" --{name} {}", shell_word(&value));
            let until = arguments.until.iter().map(|stage| option("until", stage.clone()));
            let given = arguments.store.given().into_iter();
            let given = given.map(|folder| option("store", folder.display().to_string()));
            let words: String = until.chain(given).collect();
            let (path, sets) = (shell_word(&history.path), set_options(&history.overrides));
            return Ok(upstream::pull_command(&format!("{path}{sets}{words}")));
        }
    }
    Ok(None)
}
