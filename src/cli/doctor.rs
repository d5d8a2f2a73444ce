//! `deaflow doctor`: checks whether a store works on its file system.

use clap::Args;
use serde_json::json;

use super::arguments::StoreArguments;
use super::table::Cell;
use super::text::Text;
use super::tone::Tone;
use super::{CliError, Exit, Output, locate, table};
use deaflow_store::{CheckResult, LockingMethod, OperationTime, Store};

/// Check the file system of a store: locks, links, clocks, space
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow doctor --store /shared/store"))]
pub struct DoctorArguments {
    #[command(flatten)]
    pub store: StoreArguments,
    /// Measure the time of the file operations that workers use
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
    let describe = |result: CheckResult| match result {
        CheckResult::Good => ("good", Tone::Good),
        CheckResult::Noted => ("noted", Tone::Caution),
        CheckResult::Bad => ("bad", Tone::Bad),
    };
    let method = match found.choice.method {
        LockingMethod::Locks => "locks",
        LockingMethod::Claims => "claims",
    };
    let document = || {
        let checks = found.checks.iter();
        let checks = checks
            .map(|check| json!({ "name": check.name, "verdict": describe(check.result).0, "found": check.found }));
        let mut document = json!({
            "store": store.root(),
            "file_system": found.file_system,
            "locking": method,
            "why": found.choice.reason,
            "trials": checks.collect::<Vec<_>>(),
        });
        if arguments.measure {
            let service = |service: &OperationTime| {
                json!({
                    "name": service.name,
                    "requests": service.requests,
                    "seconds": service.seconds,
                })
            };
            document["services"] = services.iter().map(service).collect();
        }
        document
    };
    let text = || {
        let mut text = Text::from(format!(
            "{} on {}: processes exclude each other by {method}: {}",
            store.root().display(),
            found.file_system,
            found.choice.reason
        ));
        let mut checks = table::table(&["check", "", "found"], &[]).flowing(&["found"]);
        for check in &found.checks {
            let (word, tone) = describe(check.result);
            checks.add_row([
                Cell::from(check.name),
                Cell::toned(word, tone),
                Cell::from(&check.found),
            ]);
        }
        text.table(checks);
        if arguments.measure {
            let mut times = table::table(&["operation", "requests", "median"], &["requests", "median"]);
            for service in &services {
                let seconds = format!("{:.0} µs", 1e6 * service.seconds);
                times.add_row([service.name, &service.requests.to_string(), &seconds]);
            }
            text.line("").table(times);
        }
        text
    };
    output.result(document, text)?;
    let is_bad = found.checks.iter().any(|check| check.result == CheckResult::Bad);
    Ok(if is_bad { Exit::Failure } else { Exit::Done })
}
