//! `deaflow unpin`: allows `gc` to remove an artifact again.

use clap::Args;

use super::arguments::StoreArguments;
use super::{CliError, Exit, Output, locate, pin};
use deaflow_base::ArtifactId;
use deaflow_store::{Pin, Store};

/// Allow gc to remove an artifact again
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow unpin pipeline.yaml:verified"))]
pub struct UnpinArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, a digest or its first digits, at least 4, or a label
    #[arg(value_name = "STAGE-OR-DIGEST")]
    artifact: String,
    #[command(flatten)]
    store: StoreArguments,
}

/// Finds a pinned artifact by the stage of a past run, or by its label; otherwise the artifact of the reference.
fn of_stage(store: &Store, pins: &[Pin], reference: &str) -> Result<ArtifactId, CliError> {
    let is_pinned = |digest: &ArtifactId| pins.iter().any(|pin| pin.digest == *digest);
    let located = locate::artifact(store, reference).map(|artifact| artifact.digest());
    if let Ok(digest) = &located
        && is_pinned(digest)
    {
        return Ok(*digest);
    }
    // The pinned artifact may be gone, or from an older run.
    let mut named: Vec<ArtifactId> = Vec::new();
    for run in store.runs()? {
        let run = run?;
        let stages = run
            .stages
            .iter()
            .filter(|stage| stage.name == reference && is_pinned(&stage.artifact));
        for stage in stages {
            if !named.contains(&stage.artifact) {
                named.push(stage.artifact);
            }
        }
    }
    match named.as_slice() {
        [one] => Ok(*one),
        [] => of_label(pins, reference).map_or(located, Ok),
        several => {
            let list: Vec<String> = several.iter().map(ArtifactId::short).collect();
            let message = format!("{} pinned artifacts belong to a stage `{reference}`", several.len());
            Err(CliError::bad_input(message).help(format!("choose one: {}", list.join(", "))))
        }
    }
}

/// Returns the only pinned artifact with a label.
fn of_label(pins: &[Pin], label: &str) -> Option<ArtifactId> {
    let mut labelled = pins.iter().filter(|pin| pin.label == label);
    let found = labelled.next()?.digest;
    labelled.next().is_none().then_some(found)
}

pub fn execute(arguments: &UnpinArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::existing_store(&arguments.store.folder_of_any([&arguments.artifact]))?;
    let digits = arguments.artifact.to_ascii_lowercase();
    // The artifact may be gone: pins are searched first.
    let pins = store.pins()?;
    let pinned: Vec<_> = pins
        .iter()
        .filter(|pin| pin.digest.to_string().starts_with(&digits))
        .collect();
    let digest = match pinned.as_slice() {
        [one] if digits.len() >= locate::MIN_DIGITS => one.digest,
        _ => of_stage(&store, &pins, &arguments.artifact)?,
    };
    let label = |pin: &Pin| match pin.label.as_str() {
        "" => String::new(),
        label => format!(" ({label})"),
    };
    let label = pins
        .iter()
        .find(|pin| pin.digest == digest)
        .map(label)
        .unwrap_or_default();
    if !store.unpin(&digest)? {
        return Err(
            CliError::bad_input(format!("artifact {} is not pinned", digest.short()))
                .help("list the pins with `deaflow pin`"),
        );
    }
    if !output.is_json() {
        output.text(format!("unpinned {}{label}", digest.short()))?;
    }
    pin::list(&store, output)
}
