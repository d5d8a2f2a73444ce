//! The command line: one file per command. Commands speak through one `Output` and fail with one error type, so
//! that exit codes and `--json` are the same everywhere.

mod accuracy;
mod arguments;
mod audit;
mod dag;
mod error;
mod explain;
mod export;
mod fsck;
mod gc;
mod locate;
mod model;
mod output;
mod path;
mod pin;
mod plan;
mod predict;
mod progress;
mod report;
mod run;
mod schema;
mod screen;
mod show;
mod solve;
mod statistics;
mod status;
mod table;
mod write;

use std::ffi::OsString;

use clap::Parser;

use arguments::{Cli, Command};
use error::CliError;
use output::Output;

pub use output::Exit;

/// Runs a command line and says how it ended.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> Exit {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    match Cli::try_parse_from(&arguments) {
        Ok(cli) => {
            let output = Output::new(cli.command.json());
            let done = dispatch(&cli.command, &output);
            output.end(done)
        }
        // clap has read nothing: whether JSON is wanted must be seen in the words themselves.
        Err(error) => Output::new(arguments.iter().any(|a| a == "--json")).usage(&error),
    }
}

fn dispatch(command: &Command, output: &Output) -> Result<Exit, CliError> {
    if let Some(jobs) = command.jobs() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs));
        pool.build_global()
            .map_err(|e| CliError::failure(format!("cannot start {jobs} threads: {e}")))?;
    }
    match command {
        Command::Run(arguments) => run::execute(arguments, output),
        Command::Plan(arguments) => plan::execute(arguments, output),
        Command::Status(arguments) => status::execute(arguments, output),
        Command::Explain(arguments) => explain::execute(arguments, output),
        Command::Dag(arguments) => dag::execute(arguments, output),
        Command::Schema(arguments) => schema::execute(arguments, output),
        Command::Show(arguments) => show::execute(arguments, output),
        Command::Fsck(arguments) => fsck::execute(arguments, output),
        Command::Screen(arguments) => screen::execute(arguments, output),
        Command::Gc(arguments) => gc::execute(arguments, output),
        Command::Pin(arguments) => pin::execute(arguments, output),
        Command::Unpin(arguments) => pin::remove(arguments, output),
        Command::Solve(arguments) => solve::execute(arguments, output),
        Command::Predict(arguments) => predict::execute(arguments, output),
        Command::Export(arguments) => export::execute(arguments, output),
        Command::Report(arguments) => report::execute(arguments, output),
        Command::Accuracy(arguments) => accuracy::execute(arguments, output),
        Command::Audit(arguments) => audit::execute(arguments, output),
    }
}
