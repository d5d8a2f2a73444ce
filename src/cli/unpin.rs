//! `deaflow unpin`: lets `gc` take an artifact again.

use clap::Args;

use super::arguments::StoreArguments;
use super::error::CliError;
use super::examples::examples;
use super::output::{Exit, Output};
use super::{locate, pin};

/// Let gc take an artifact again
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow unpin pipeline.yaml:verified"))]
pub struct UnpinArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or at least its first 4 digits
    #[arg(value_name = "STAGE-OR-DIGEST")]
    artifact: String,
    #[command(flatten)]
    store: StoreArguments,
}

/// The artifact may be gone: pins are found by their own digests first.
pub fn execute(arguments: &UnpinArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::existing_store(&arguments.store.folder_of_any([&arguments.artifact]))?;
    let wanted = arguments.artifact.to_ascii_lowercase();
    let pins = store.pins()?;
    let pinned: Vec<_> = pins
        .iter()
        .filter(|pin| pin.digest.to_string().starts_with(&wanted))
        .collect();
    let digest = match pinned.as_slice() {
        [one] if wanted.len() >= 4 => one.digest,
        _ => locate::artifact(&store, &arguments.artifact)?.digest(),
    };
    if !store.unpin(&digest)? {
        return Err(
            CliError::bad_input(format!("artifact {} is not pinned", digest.short()))
                .help("`deaflow pin` without an artifact lists the pins"),
        );
    }
    pin::list(&store, output)
}
