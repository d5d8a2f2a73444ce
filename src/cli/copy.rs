//! `deaflow copy`: copies an artifact and its inputs into another store.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::arguments::StoreArguments;
use super::progress::DelayedBar;
use super::{CliError, Exit, Output, locate, table, write};
use deaflow_store::{Artifact, CopySummary, Store};

/// Copy an artifact and its inputs into another store
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow copy solved --to /shared/store"))]
pub struct CopyArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or its first digits, at least 4
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: String,
    /// The other store; it is created if missing
    #[arg(long, value_name = "STORE")]
    pub to: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
}

pub fn execute(arguments: &CopyArguments, output: &Output) -> Result<Exit, CliError> {
    let folder = arguments.store.folder_of_any([&arguments.artifact]);
    let store = locate::existing_store(&folder)?;
    let artifact = locate::artifact(&store, &arguments.artifact)?;
    if write::is_same_file(&folder, &arguments.to) {
        return Err(
            CliError::bad_input(format!("{} is the source store", arguments.to.display()))
                .help("name another store with --to"),
        );
    }
    let target = Store::open(&arguments.to)?;
    let copied = copy(&store, &target, &artifact)?;
    output.result(
        || document(arguments, &artifact, &copied),
        || text(arguments, &artifact, &copied),
    )?;
    for digest in &copied.without_record {
        output.warn(format_args!(
            "artifact {} has no record: a run there cannot reuse it",
            digest.short()
        ));
    }
    Ok(Exit::Done)
}

fn copy(store: &Store, target: &Store, artifact: &Artifact) -> Result<CopySummary, CliError> {
    let bar = DelayedBar::new("copy", "artifacts");
    let copied = store.copy_to(target, artifact.digest(), &|done, total| bar.set(done, total));
    bar.clear();
    Ok(copied?)
}

fn document(arguments: &CopyArguments, artifact: &Artifact, copied: &CopySummary) -> serde_json::Value {
    json!({
        "artifact": artifact.digest().to_string(),
        "from": arguments.store.folder_of_any([&arguments.artifact]),
        "to": arguments.to,
        "artifacts": copied.artifacts,
        "bytes": copied.bytes,
        "records": copied.records,
        "artifacts_there": copied.artifacts_there,
        "records_there": copied.records_there,
        "without_record": copied.without_record.iter().map(ToString::to_string).collect::<Vec<_>>(),
    })
}

fn text(arguments: &CopyArguments, artifact: &Artifact, copied: &CopySummary) -> String {
    let there = match (copied.artifacts_there, copied.records_there) {
        (0, 0) => String::new(),
        (artifacts, records) => format!(
            "; already there: {} and {}",
            table::counted(artifacts, "artifacts"),
            table::counted(records, "records")
        ),
    };
    format!(
        "{} to {}: copied {} ({}) and {}{there}",
        artifact.digest().short(),
        arguments.to.display(),
        table::counted(copied.artifacts, "artifacts"),
        table::bytes(copied.bytes),
        table::counted(copied.records, "records")
    )
}
