//! `deaflow doctor`: whether a store can work where it is, and how its processes keep out of each other's way.

use clap::Args;
use serde_json::json;

use super::arguments::StoreArguments;
use super::error::CliError;
use super::output::{Exit, Output};
use super::{locate, table};
use crate::store::{Manner, Store, Verdict};

/// Try what a store needs of its file system: locks, links, clocks, room
#[derive(Debug, Args)]
pub struct DoctorArguments {
    #[command(flatten)]
    pub store: StoreArguments,
}

pub fn execute(arguments: &DoctorArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::of_folder(Store::open_existing(&arguments.store.folder()))?;
    let found = store.examine()?;
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
        output.document(&json!({
            "store": store.root(),
            "file_system": found.file_system,
            "locking": manner,
            "why": found.choice.why,
            "trials": trials.collect::<Vec<_>>(),
        }))?;
    } else {
        let mut trials = table::table(&["tried", "", "found"], &[]);
        for trial in &found.trials {
            trials.add_row([trial.name, word(trial.verdict), &trial.found]);
        }
        output.text(&format!(
            "{} on {}: processes keep apart by {manner}, since {}\n{trials}",
            store.root().display(),
            found.file_system,
            found.choice.why
        ))?;
    }
    let is_bad = found.trials.iter().any(|trial| trial.verdict == Verdict::Bad);
    Ok(if is_bad { Exit::Failure } else { Exit::Done })
}
