//! `deaflow push`: sends artifacts and signed records to a remote.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use serde_json::json;

use super::arguments::{SetArguments, StoreArguments};
use super::progress::DelayedBar;
use super::{CliError, Exit, Output, locate, pipeline, table, upstream};
use deaflow_base::ArtifactId;
use deaflow_orchestrator::{Pipeline, built_stages};
use deaflow_remote::{Configuration, Push, PushReport, Remote, SigningKey, push};
use deaflow_store::Store;

/// Send artifacts and signed records to a remote, so that others can reuse them
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow push", "deaflow push pipeline.yaml --remote lab"))]
pub struct PushArguments {
    /// Send only the artifacts of this pipeline, and those that they were made from [default: all of the store]
    pub pipeline: Option<PathBuf>,
    /// The remote [default: $DEAFLOW_REMOTE, or the only one]
    #[arg(long, value_name = "NAME")]
    pub remote: Option<String>,
    /// Also send objects and records that the remote has: they may be damaged, or about to expire
    #[arg(long)]
    pub again: bool,
    #[command(flatten)]
    pub store: StoreArguments,
    #[command(flatten)]
    pub set: SetArguments,
}

pub fn execute(arguments: &PushArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::existing_store(&arguments.store.folder_for(arguments.pipeline.as_deref()))?;
    let pipeline = arguments
        .pipeline
        .as_ref()
        .map(|path| pipeline::load_with(path, &arguments.set))
        .transpose()?;
    let configuration = Configuration::of_user()?;
    let key = SigningKey::read(&configuration.signing_key())?.ok_or_else(|| {
        CliError::bad_input("no signing key")
            .help("create one with `deaflow remote key`, which prints the public key for others to trust")
    })?;
    let (remote, foreign) = upstream::open_fresh(arguments.remote.as_deref(), &store, output)?;
    let remote = Arc::new(remote);
    let roots = pipeline
        .as_ref()
        .map(|pipeline| roots(pipeline, &store, &remote))
        .transpose()?;
    let bar = DelayedBar::new("push", "artifacts");
    let all = Push {
        store: &store,
        remote: &remote,
        key: &key,
        roots,
        again: arguments.again,
    };
    let done = push(&all, &|done, total| bar.set(done, total));
    bar.clear();
    let pushed = done?;
    store.save_index();
    upstream::report_problems(&remote, output);
    let document = || {
        json!({
            "remote": remote.name(),
            "place": remote.place(),
            "key": key.public().to_string(),
            "objects": pushed.objects,
            "bytes": pushed.bytes,
            "records": pushed.records,
            "objects_there": pushed.objects_there,
            "records_there": pushed.records_there,
            "records_of_others": pushed.records_of_others,
            "left": left(&pushed.failed),
            "passed_over": upstream::ignored_document(&remote, &foreign),
        })
    };
    output.result(document, || text(remote.name(), &pushed))?;
    for (artifact, why) in &pushed.failed {
        output.warn(format_args!("artifact {} not sent: {why}", artifact.short()));
    }
    Ok(match pushed.failed.is_empty() {
        true => Exit::Done,
        false => Exit::Damaged,
    })
}

fn left(left: &[(ArtifactId, String)]) -> Vec<serde_json::Value> {
    let document = |(artifact, why): &(ArtifactId, String)| json!({ "artifact": artifact.to_string(), "why": why });
    left.iter().map(document).collect()
}

/// Returns the artifacts of built stages that are in the store; others may be on the remote.
fn roots(pipeline: &Pipeline, store: &Store, remote: &Arc<Remote>) -> Result<Vec<ArtifactId>, CliError> {
    let built = built_stages(pipeline, &store.clone().with_upstream(remote.clone()))?;
    let artifacts = built.stages.iter().map(|stage| stage.record.artifact);
    let here: Vec<ArtifactId> = artifacts.filter(|artifact| store.has(artifact)).collect();
    match here.is_empty() {
        true => Err(
            CliError::bad_input(format!("no stage of {} is built here", pipeline.name))
                .help("build it with deaflow run"),
        ),
        false => Ok(here),
    }
}

fn text(name: &str, pushed: &PushReport) -> String {
    let there = match (pushed.objects_there, pushed.records_there) {
        (0, 0) => String::new(),
        (objects, records) => format!(
            "; already there: {} and {}",
            table::counted(objects, "artifacts"),
            table::counted(records, "records")
        ),
    };
    let others = match pushed.records_of_others {
        0 => String::new(),
        n => format!("; not sent: {n} records that others have signed"),
    };
    format!(
        "to {name}: sent {} ({}) and {}{there}{others}",
        table::counted(pushed.objects, "artifacts"),
        table::bytes(pushed.bytes),
        table::counted(pushed.records, "records")
    )
}
