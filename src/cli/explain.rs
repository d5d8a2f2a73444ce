//! `deaflow explain`: lists the changes because of which a stage would be built.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::arguments::{SetArguments, StoreArguments, pipeline_in, pipeline_parser};
use super::{CliError, Exit, Output, locate, pipeline};
use deaflow_base::{ArtifactId, Digest, readable_time};
use deaflow_orchestrator::{Explanation, explain};

/// Explain why a stage would be built: all changed parameters and inputs
#[derive(Debug, Args)]
#[command(allow_missing_positional = true)]
#[command(after_help = examples!("deaflow explain pipeline.yaml design", "deaflow explain pipeline.yaml:design"))]
pub struct ExplainArguments {
    /// The pipeline: a YAML file, or a folder with exactly one [default: the current folder]
    #[arg(value_parser = pipeline_parser())]
    pub pipeline: Option<PathBuf>,
    /// The stage, or PIPELINE.yaml:STAGE without PIPELINE
    pub stage: String,
    #[command(flatten)]
    pub store: StoreArguments,
    #[command(flatten)]
    pub set: SetArguments,
}

pub fn execute(arguments: &ExplainArguments, output: &Output) -> Result<Exit, CliError> {
    let split = |both| locate::split(both).map(|(path, stage)| (PathBuf::from(path), stage));
    let both = split(&arguments.stage).or_else(|| locate::split_folder(&arguments.stage));
    let (path, stage) = match (both.filter(|_| arguments.pipeline.is_none()), &arguments.pipeline) {
        (Some(both), _) => both,
        (None, Some(path)) => (path.clone(), arguments.stage.as_str()),
        (None, None) => (pipeline_here(&arguments.stage)?, arguments.stage.as_str()),
    };
    let pipeline = pipeline::load_with(&path, &arguments.set)?;
    let (_scratch, store) = pipeline::store_to_read(&arguments.store.folder_of(&path))?;
    let found = explain(&pipeline, &store, stage)?;
    pipeline.bare_numbers.iter().for_each(|note| output.warn_of_units(note));
    output.result(|| document(&found), || text(&found))
}

/// Returns the pipeline of the current folder, for a stage without a pipeline. Refuses files and digests.
fn pipeline_here(stage: &str) -> Result<PathBuf, CliError> {
    if Path::new(stage).is_file() {
        return Err(
            CliError::bad_input(format!("{stage} is a file; a stage is missing")).help(format!(
                "deaflow explain {stage} STAGE; list the stages with `deaflow plan {stage}`"
            )),
        );
    }
    // Names of stages do not look like this.
    if stage.len() >= Digest::SHORT && stage.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return Err(
            CliError::bad_input(format!("{stage} is a digest, not a stage")).help(format!(
                "deaflow explain PIPELINE.yaml STAGE; show the artifact with `deaflow show {stage}`"
            )),
        );
    }
    pipeline_in(PathBuf::from(".")).map_err(|why| {
        let help = "deaflow explain PIPELINE.yaml STAGE; show an artifact with `deaflow show DIGEST`";
        CliError::bad_input(format!("{stage}: {why}")).help(help)
    })
}

fn document(found: &Explanation) -> serde_json::Value {
    let text = |digest: &Option<ArtifactId>| digest.map(|digest| digest.to_string());
    let inputs = found.inputs.iter();
    let inputs = inputs.map(|(name, digest)| json!({ "stage": name, "digest": text(digest) }));
    json!({
        "stage": found.report,
        "key": found.key.map(|key| key.to_string()),
        "reasons": found.reasons.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "inputs": inputs.collect::<Vec<_>>(),
        "causes": found.causes.iter().map(|(name, reasons)| json!({
            "stage": name,
            "reasons": reasons.iter().map(ToString::to_string).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
        "last": found.last.as_ref().map(|last| json!({
            "same": last.is_same,
            "created": last.created,
            "key": last.key.to_string(),
            "artifact": last.artifact.to_string(),
        })),
    })
}

fn text(found: &Explanation) -> String {
    let report = &found.report;
    let mut lines = Vec::new();
    let made = report
        .digest
        .map_or_else(String::new, |digest| format!(": artifact {}", digest.short()));
    if found.reasons.is_empty() {
        lines.push(format!("{} ({}) would be reused{made}", report.name, report.kind));
    } else {
        lines.push(format!("{} ({}) would be built:", report.name, report.kind));
        lines.extend(found.reasons.iter().map(|reason| format!("  {reason}")));
        for (name, reasons) in &found.causes {
            let reasons: Vec<String> = reasons.iter().map(ToString::to_string).collect();
            lines.push(format!("  because of {name}: {}", reasons.join("; ")));
        }
        lines.push(format!(
            "chunks: {} to build, {} built",
            report.chunks_built, report.chunks_reused
        ));
    }
    if !found.inputs.is_empty() {
        lines.push("inputs:".to_owned());
        let known =
            |digest: &Option<ArtifactId>| digest.map_or_else(|| "not built".to_owned(), |digest| digest.short());
        lines.extend(
            found
                .inputs
                .iter()
                .map(|(name, digest)| format!("  {name}: {}", known(digest))),
        );
    }
    lines.push(match &found.last {
        Some(last) => {
            let what = match last.is_same {
                true => "last run with this action",
                false => "last run with this stage, with other parameters or inputs",
            };
            format!(
                "{what}: {}, artifact {}",
                readable_time(&last.created),
                last.artifact.short()
            )
        }
        None => "no run has built it".to_owned(),
    });
    lines.join("\n")
}
