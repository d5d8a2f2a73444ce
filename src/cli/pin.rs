//! `deaflow pin`, `deaflow unpin`: artifacts that `gc` keeps whatever the runs say.

use serde_json::json;

use super::arguments::{PinArguments, UnpinArguments};
use super::error::CliError;
use super::output::{Exit, Output};
use super::{locate, table};
use crate::orchestrator::Environment;
use crate::store::{Pin, Store};

pub fn execute(arguments: &PinArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::existing_store(&arguments.store.folder())?;
    if let Some(reference) = &arguments.artifact {
        let artifact = locate::artifact(&store, reference)?;
        store.pin(&Pin {
            digest: artifact.digest(),
            label: arguments.label.clone().unwrap_or_default(),
            created: Environment::system().now(),
        })?;
    }
    tell(&store, output)
}

/// Removes a pin. The artifact may be gone: pins are found by their own digests first.
pub fn remove(arguments: &UnpinArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::existing_store(&arguments.store.folder())?;
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
    tell(&store, output)
}

fn tell(store: &Store, output: &Output) -> Result<Exit, CliError> {
    let pins = store.pins()?;
    if output.is_json() {
        let pin = |pin: &Pin| json!({ "digest": pin.digest.to_string(), "label": pin.label, "created": pin.created });
        output.document(&json!({ "pins": pins.iter().map(pin).collect::<Vec<_>>() }))?;
        return Ok(Exit::Done);
    }
    if pins.is_empty() {
        output.text("no pins")?;
        return Ok(Exit::Done);
    }
    let mut table = table::table(&["artifact", "pinned", "label"], &[]);
    for pin in pins {
        table.add_row([pin.digest.short(), pin.created, pin.label]);
    }
    output.text(&table.trim_fmt())?;
    Ok(Exit::Done)
}
