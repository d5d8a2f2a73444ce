//! `deaflow pull`: fetches artifacts and records from a remote.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::arguments::{SetArguments, StoreArguments};
use super::progress::DelayedBar;
use super::upstream;
use super::{CliError, Exit, Output, pipeline, table};
use deaflow_base::ArtifactId;
use deaflow_orchestrator::built_stages;
use deaflow_remote::{IgnoredRecords, PublicKey, PullReport, Remote, pull_all, pull_some};
use deaflow_store::Store;

/// Fetch artifacts and records from a remote, and verify them
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow pull", "deaflow pull pipeline.yaml --remote lab"))]
pub struct PullArguments {
    /// Fetch only the artifacts of this pipeline [default: all that trusted keys have signed]
    #[arg(conflicts_with = "records_only")]
    pub pipeline: Option<PathBuf>,
    /// The remote [default: $DEAFLOW_REMOTE, or the only one]
    #[arg(long, value_name = "NAME")]
    pub remote: Option<String>,
    /// Fetch only records: a run with --remote fetches the artifacts that it needs
    #[arg(long)]
    pub records_only: bool,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Stop after this stage
    #[arg(long, value_name = "STAGE", requires = "pipeline")]
    pub until: Option<String>,
    #[command(flatten)]
    pub set: SetArguments,
}

pub fn execute(arguments: &PullArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = arguments
        .pipeline
        .as_ref()
        .map(|path| {
            let pipeline = pipeline::load_with(path, &arguments.set)?;
            let selection = pipeline.selection(arguments.until.as_deref())?;
            Ok::<_, CliError>((pipeline, selection))
        })
        .transpose()?;
    let store = Store::open(&arguments.store.folder_for(arguments.pipeline.as_deref()))?;
    let (remote, foreign) = upstream::open_fresh(arguments.remote.as_deref(), &store, output)?;
    let remote = std::sync::Arc::new(remote);
    let store = store.with_upstream(remote.clone());
    let (mut missing, mut lost) = (Vec::new(), Vec::new());
    let bar = DelayedBar::new("pull", "artifacts");
    let progress = |done, total| bar.set(done, total);
    let done = match &pipeline {
        _ if arguments.records_only => Ok(PullReport {
            records: remote.count_records(),
            ..PullReport::default()
        }),
        None => pull_all(&store, &remote, &progress),
        Some((pipeline, selection)) => {
            let selected: Vec<&str> = selection
                .iter()
                .map(|&index| pipeline.stages[index].name.as_str())
                .collect();
            remote.retry();
            let mut built = built_stages(pipeline, &store)?;
            let stages = built
                .stages
                .iter()
                .filter(|stage| selected.contains(&stage.name.as_str()));
            let artifacts: Vec<ArtifactId> = stages.map(|stage| stage.record.artifact).collect();
            for name in built
                .missing
                .into_iter()
                .filter(|name| selected.contains(&name.as_str()))
            {
                match built.lost.remove(&name) {
                    Some(artifact) => lost.push(artifact),
                    None => missing.push(name),
                }
            }
            pull_some(&store, &remote, &artifacts, &progress)
        }
    };
    bar.clear();
    let mut pulled = done?;
    pulled.failed.append(&mut lost);
    pulled.failed.sort_unstable();
    pulled.failed.dedup();
    upstream::report_problems(&remote, output);
    output.result(
        || document(&remote, &pulled, &missing, &foreign),
        || text(arguments, remote.name(), &pulled, &missing),
    )?;
    // What others have signed may contain these stages.
    if !missing.is_empty() && !foreign.untrusted.is_empty() {
        let keys: Vec<String> = foreign.untrusted.keys().map(PublicKey::short).collect();
        let error = CliError::failure(format!(
            "{} did not fetch {}: records of untrusted keys are ignored",
            remote.name(),
            missing.join(", ")
        ));
        let trust = format!("to trust a key, add it to the keys of the remote: {}", keys.join(", "));
        output.report(&error.help(trust));
        return Ok(Exit::Failure);
    }
    let are_records_sound = foreign.damaged().next().is_none() && remote.disagreements().is_empty();
    Ok(match pulled.failed.is_empty() && are_records_sound {
        true => Exit::Done,
        false if remote.is_disabled() => Exit::TryAgain,
        false => Exit::Failure,
    })
}

fn document(remote: &Remote, pulled: &PullReport, missing: &[String], foreign: &IgnoredRecords) -> serde_json::Value {
    json!({
        "remote": remote.name(),
        "place": remote.place(),
        "artifacts": pulled.artifacts,
        "bytes": pulled.bytes,
        "artifacts_here": pulled.artifacts_here,
        "records": pulled.records,
        "left": pulled.failed.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "not_built": missing,
        "passed_over": upstream::ignored_document(remote, foreign),
    })
}

fn text(arguments: &PullArguments, name: &str, pulled: &PullReport, missing: &[String]) -> String {
    if arguments.records_only {
        return format!("from {name}: {} records", pulled.records);
    }
    let mut text = format!(
        "from {name}: fetched {} ({}); already here: {}",
        table::counted(pulled.artifacts, "artifacts"),
        table::bytes(pulled.bytes),
        pulled.artifacts_here
    );
    if !pulled.failed.is_empty() {
        text += &format!("; not fetched: {}", pulled.failed.len());
    }
    if !missing.is_empty() {
        text += &format!("\nnot built: {}", missing.join(", "));
    }
    text
}
