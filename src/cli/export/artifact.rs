//! `deaflow export artifact`: an artifact as a standalone HDF5 file.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use crate::arguments::StoreArguments;
use crate::progress::Bar;
use crate::{CliError, Exit, Output, locate, table, write};
use deaflow_base::software;
use deaflow_store::{Ancestor, write_standalone};

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow export artifact solved -o solved.h5"))]
pub struct ExportArtifactArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or its first digits, at least 4
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: String,
    /// The output; an existing file is replaced
    #[arg(short, long, value_name = "FILE.h5")]
    pub output: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
}

pub fn execute(arguments: &ExportArtifactArguments, output: &Output) -> Result<Exit, CliError> {
    write::check_output(&arguments.output, std::slice::from_ref(&arguments.artifact))?;
    let store = locate::existing_store(&arguments.store.folder_of_any([&arguments.artifact]))?;
    let artifact = locate::artifact(&store, &arguments.artifact)?;
    write::check_not_read(&arguments.output, &[artifact.path().to_string_lossy()])?;
    let ancestry = store.ancestry(&artifact)?;
    let bar = Bar::new("export", "chunks", artifact.parts().len().max(1) as u64);
    write_standalone(&arguments.output, &artifact, &ancestry, &software(), &bar)?;
    bar.clear();
    let bytes = std::fs::metadata(&arguments.output).map_or(0, |metadata| metadata.len());
    let unknown: Vec<String> = ancestry
        .iter()
        .filter(|action| action.entries.is_empty())
        .map(Ancestor::name)
        .collect();
    let document = || {
        json!({
            "file": arguments.output,
            "artifact": artifact.digest().to_string(),
            "kind": artifact.kind(),
            "bytes": bytes,
            "chunks": artifact.parts().len(),
            "actions": ancestry.iter().map(Ancestor::name).collect::<Vec<_>>(),
            "unknown": unknown,
        })
    };
    output.result(document, || {
        format!(
            "{}: artifact {} ({}), made by {}",
            arguments.output.display(),
            artifact.digest().short(),
            table::bytes(bytes),
            table::counted(ancestry.len() as u64, "actions")
        )
    })?;
    for name in unknown {
        output.warn(format_args!(
            "{name} is not in the store: the file does not describe how it was made"
        ));
    }
    Ok(Exit::Done)
}
