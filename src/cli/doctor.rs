//! `deaflow doctor`: whether a store can work where it is, and how its processes keep out of each other's way.

use clap::Args;
use serde_json::json;

use super::arguments::StoreArguments;
use super::error::CliError;
use super::examples::examples;
use super::output::{Exit, Output};
use super::text::Text;
use super::tone::Tone;
use super::{locate, table};
use deaflow_store::{Manner, Service, Store, Verdict};

/// Try what a store needs of its file system: locks, links, clocks, room
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow doctor --store /shared/store"))]
pub struct DoctorArguments {
    #[command(flatten)]
    pub store: StoreArguments,
    /// Measure how long what workers ask of the file system takes
    #[arg(long)]
    pub measure: bool,
}

pub fn execute(arguments: &DoctorArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::of_folder(Store::open_existing(&arguments.store.folder()))?;
    let found = store.examine()?;
    let services = match arguments.measure {
        true => store.measure()?,
        false => Vec::new(),
    };
    let word = |verdict: Verdict| match verdict {
        Verdict::Good => "good",
        Verdict::Noted => "noted",
        Verdict::Bad => "bad",
    };
    let manner = match found.choice.manner {
        Manner::Locks => "locks",
        Manner::Claims => "claims",
    };
    if output.is_json() {
        let trials = found.trials.iter();
        let trials =
            trials.map(|trial| json!({ "name": trial.name, "verdict": word(trial.verdict), "found": trial.found }));
        let mut document = json!({
            "store": store.root(),
            "file_system": found.file_system,
            "locking": manner,
            "why": found.choice.why,
            "trials": trials.collect::<Vec<_>>(),
        });
        if arguments.measure {
            let service = |service: &Service| json!({ "name": service.name, "requests": service.requests, "seconds": service.seconds });
            document["services"] = services.iter().map(service).collect();
        }
        output.document(&document)?;
    } else {
        let mut trials = table::table(&["tried", "", "found"], &[]).flowing(&["found"]);
        for trial in &found.trials {
            let tone = match trial.verdict {
                Verdict::Good => Tone::Good,
                Verdict::Noted => Tone::Caution,
                Verdict::Bad => Tone::Bad,
            };
            trials.add_row([
                table::Cell::from(trial.name),
                table::Cell::toned(word(trial.verdict), tone),
                table::Cell::from(&trial.found),
            ]);
        }
        let mut text = Text::from(format!(
            "{} on {}: processes keep apart by {manner}, since {}",
            store.root().display(),
            found.file_system,
            found.choice.why
        ));
        text.table(trials);
        output.text(text)?;
        if arguments.measure {
            let mut rows = table::table(&["service", "requests", "median"], &["requests", "median"]);
            for service in &services {
                let seconds = format!("{:.0} µs", 1e6 * service.seconds);
                rows.add_row([service.name, &service.requests.to_string(), &seconds]);
            }
            let mut text = Text::from("");
            text.table(rows);
            output.text(text)?;
        }
    }
    let is_bad = found.trials.iter().any(|trial| trial.verdict == Verdict::Bad);
    Ok(if is_bad { Exit::Failure } else { Exit::Done })
}
