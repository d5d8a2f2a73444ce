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
use deaflow_store::{CheckResult, LockingMethod, OperationTime, Store};

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
    let found = store.check_file_system()?;
    let services = match arguments.measure {
        true => store.measure_file_system()?,
        false => Vec::new(),
    };
    let word = |result: CheckResult| match result {
        CheckResult::Good => "good",
        CheckResult::Noted => "noted",
        CheckResult::Bad => "bad",
    };
    let manner = match found.choice.method {
        LockingMethod::Locks => "locks",
        LockingMethod::Claims => "claims",
    };
    if output.is_json() {
        let checks = found.checks.iter();
        let checks =
            checks.map(|check| json!({ "name": check.name, "result": word(check.result), "found": check.found }));
        let mut document = json!({
            "store": store.root(),
            "file_system": found.file_system,
            "locking": manner,
            "why": found.choice.reason,
            "checks": checks.collect::<Vec<_>>(),
        });
        if arguments.measure {
            let service = |service: &OperationTime| json!({ "name": service.name, "requests": service.requests, "seconds": service.seconds });
            document["services"] = services.iter().map(service).collect();
        }
        output.document(&document)?;
    } else {
        let mut checks = table::table(&["tried", "", "found"], &[]).flowing(&["found"]);
        for check in &found.checks {
            let tone = match check.result {
                CheckResult::Good => Tone::Good,
                CheckResult::Noted => Tone::Caution,
                CheckResult::Bad => Tone::Bad,
            };
            checks.add_row([
                table::Cell::from(check.name),
                table::Cell::toned(word(check.result), tone),
                table::Cell::from(&check.found),
            ]);
        }
        let mut text = Text::from(format!(
            "{} on {}: processes keep apart by {manner}, since {}",
            store.root().display(),
            found.file_system,
            found.choice.reason
        ));
        text.table(checks);
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
    let is_bad = found.checks.iter().any(|check| check.result == CheckResult::Bad);
    Ok(if is_bad { Exit::Failure } else { Exit::Done })
}
