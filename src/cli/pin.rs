//! `deaflow pin`: artifacts that `gc` keeps whatever the runs say.

use clap::Args;
use serde_json::json;

use super::arguments::StoreArguments;
use super::text::Text;
use super::{CliError, Exit, Output, locate, table};
use deaflow_base::readable_time;
use deaflow_orchestrator::Environment;
use deaflow_store::{Pin, Store};

/// Keep an artifact and what it was made from through every gc, or list the pins
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow pin pipeline.yaml:verified --label \"figure 3\"", "deaflow pin"))]
pub struct PinArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, or a digest or at least its first 4 digits
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: Option<String>,
    /// Why it is kept
    #[arg(long, value_name = "TEXT", requires = "artifact")]
    pub label: Option<String>,
    /// Keep the artifact alone: what it was made from may go
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
pub fn list(store: &Store, output: &Output) -> Result<Exit, CliError> {
    let pins = store.pins()?;
    if output.is_json() {
        let pin = |pin: &Pin| {
            json!({
                "digest": pin.digest.to_string(),
                "label": pin.label,
                "created": pin.created,
                "result_only": pin.result_only,
            })
        };
        output.document(&json!({ "pins": pins.iter().map(pin).collect::<Vec<_>>() }))?;
        return Ok(Exit::Done);
    }
    if pins.is_empty() {
        output.text(format!("no pins in {}", store.root().display()))?;
        return Ok(Exit::Done);
    }
    let mut table = table::table(&["artifact", "pinned", "keeps", "label"], &[]).flowing(&["label"]);
    for pin in pins {
        let keeps = if pin.result_only {
            "it alone"
        } else {
            "it and its inputs"
        };
        table.add_row([
            pin.digest.short(),
            readable_time(&pin.created),
            keeps.to_owned(),
            pin.label,
        ]);
    }
    output.text(Text::of(table))?;
    Ok(Exit::Done)
}
