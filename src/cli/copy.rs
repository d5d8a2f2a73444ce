//! `deaflow copy`: an artifact with all that it needs, from one store into another.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::arguments::StoreArguments;
use super::progress::DelayedBar;
use super::{CliError, Exit, Output, locate, table};
use deaflow_store::{Artifact, CopySummary, Store};

/// Copy an artifact and what it was made from into another store
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow copy solved --to /shared/store"))]
pub struct CopyArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or at least its first 4 digits
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: String,
    /// The other store; it is made where there is none
    #[arg(long, value_name = "STORE")]
    pub to: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
}

pub fn execute(arguments: &CopyArguments, output: &Output) -> Result<Exit, CliError> {
    let folder = arguments.store.folder_of_any([&arguments.artifact]);
    let store = locate::existing_store(&folder)?;
    let artifact = locate::artifact(&store, &arguments.artifact)?;
    if is_same(&folder, &arguments.to) {
        return Err(
            CliError::bad_input(format!("{} is the store that is copied from", arguments.to.display()))
                .help("--to must name another one"),
        );
    }
    let target = Store::open(&arguments.to)?;
    let copied = copy(&store, &target, &artifact)?;
    if output.is_json() {
        output.document(&document(arguments, &artifact, &copied))?;
    } else {
        output.text(text(arguments, &artifact, &copied))?;
    }
    for digest in &copied.without_record {
        output.warn(format_args!(
            "no record speaks of artifact {}: a run there cannot reuse it",
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

fn is_same(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    }
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
            "; {} and {} were there",
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
