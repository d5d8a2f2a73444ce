//! `deaflow pin`: protects artifacts from `gc`.

use clap::Args;
use serde_json::json;

use super::arguments::StoreArguments;
use super::text::Text;
use super::{CliError, Exit, Output, locate, table};
use deaflow_base::readable_time;
use deaflow_orchestrator::Environment;
use deaflow_store::{Pin, Store};

/// Protect an artifact and its inputs from gc, or list the pins
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow pin pipeline.yaml:verified --label \"figure 3\"", "deaflow pin"))]
pub struct PinArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or its first digits, at least 4
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: Option<String>,
    /// The reason
    #[arg(long, value_name = "TEXT", requires = "artifact")]
    pub label: Option<String>,
    /// Protect only the artifact, not its inputs
    #[arg(long, requires = "artifact")]
    pub result_only: bool,
    #[command(flatten)]
    pub store: StoreArguments,
}

pub fn execute(arguments: &PinArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::existing_store(&arguments.store.folder_of_any(&arguments.artifact))?;
    if let Some(reference) = &arguments.artifact {
        let artifact = locate::artifact(&store, reference)?;
        store.pin(&Pin {
            digest: artifact.digest(),
            label: arguments.label.clone().unwrap_or_default(),
            created: Environment::system().now(),
            result_only: arguments.result_only,
        })?;
    }
    list(&store, output)
}

/// Lists the pins.
///
/// # Errors
/// When the store cannot be read.
pub fn list(store: &Store, output: &Output) -> Result<Exit, CliError> {
    let pins = store.pins()?;
    let document = || {
        let pin = |pin: &Pin| {
            json!({
                "digest": pin.digest.to_string(),
                "label": pin.label,
                "created": pin.created,
                "result_only": pin.result_only,
            })
        };
        json!({ "pins": pins.iter().map(pin).collect::<Vec<_>>() })
    };
    output.result(document, || text(&pins, store))
}

fn text(pins: &[Pin], store: &Store) -> Text {
    if pins.is_empty() {
        return Text::from(format!("no pins in {}", store.root().display()));
    }
    let mut table = table::table(&["artifact", "pinned", "keeps", "label"], &[]).flowing(&["label"]);
    for pin in pins {
        let keeps = match pin.result_only {
            true => "only it",
            false => "it and its inputs",
        };
        table.add_row([
            pin.digest.short(),
            readable_time(&pin.created),
            keeps.to_owned(),
            pin.label.clone(),
        ]);
    }
    Text::of(table)
}
