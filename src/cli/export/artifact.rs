//! `deaflow export artifact`: an artifact as one HDF5 file that needs no store.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use crate::arguments::StoreArguments;
use crate::error::CliError;
use crate::examples::examples;
use crate::output::{Exit, Output};
use crate::progress::Bar;
use crate::{locate, solve, table, write};
use deaflow_base::software;
use deaflow_store::{Ancestor, write_standalone};

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow export artifact solved -o solved.h5"))]
pub struct ExportArtifactArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or at least its first 4 digits
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: String,
    /// Where it goes; an existing file is replaced
    #[arg(short, long, value_name = "FILE.h5")]
    pub output: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
}

pub fn execute(arguments: &ExportArtifactArguments, output: &Output) -> Result<Exit, CliError> {
    solve::check_not_read(&arguments.output, &[&arguments.artifact])?;
    write::check_file(&arguments.output)?;
    let store = locate::existing_store(&arguments.store.folder_of_any([&arguments.artifact]))?;
    let artifact = locate::artifact(&store, &arguments.artifact)?;
    if solve::is_same_file(artifact.path(), &arguments.output) {
        let path = arguments.output.display();
        return Err(
            CliError::bad_input(format!("{path} is read here: writing it would lose it"))
                .help("-o must name another file"),
        );
    }
    let ancestry = store.ancestry(&artifact)?;
    let bar = Bar::new("export", "chunks", artifact.parts().len().max(1) as u64);
    write_standalone(&arguments.output, &artifact, &ancestry, &software(), &bar)?;
    bar.clear();
    let bytes = std::fs::metadata(&arguments.output).map_or(0, |metadata| metadata.len());
    let unknown: Vec<String> = ancestry
        .iter()
        .filter(|action| is_unknown(action))
        .map(Ancestor::name)
        .collect();
    if output.is_json() {
        output.document(&json!({
            "file": arguments.output,
            "artifact": artifact.digest().to_string(),
            "kind": artifact.kind(),
            "bytes": bytes,
            "chunks": artifact.parts().len(),
            "actions": ancestry.iter().map(Ancestor::name).collect::<Vec<_>>(),
            "unknown": unknown,
        }))?;
    } else {
        output.text(format!(
            "{}: artifact {} ({}), made by {} actions",
            arguments.output.display(),
            artifact.digest().short(),
            table::bytes(bytes),
            ancestry.len()
        ))?;
    }
    for name in unknown {
        output.complain(&format!(
            "warning: {name} is not in the store: nothing is said of how it was made"
        ));
    }
    Ok(Exit::Done)
}

fn is_unknown(action: &Ancestor) -> bool {
    action.entries.is_empty()
}
