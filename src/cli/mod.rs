//! The command line: one file per command. Commands speak through one `Output` and fail with one error type, so
//! that exit codes and `--json` are the same everywhere.

mod accuracy;
mod arguments;
mod audit;
mod cells;
mod commands;
mod dag;
mod error;
mod explain;
mod export;
mod fsck;
mod gc;
mod locate;
mod model;
mod neglected;
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
mod simulate;
mod solve;
mod statistics;
mod status;
mod table;
mod unpin;
mod write;

use std::ffi::OsString;

use clap::Parser;

use commands::Cli;
use error::CliError;
use output::Output;

pub use output::Exit;

/// Runs a command line and says how it ended.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> Exit {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    match Cli::try_parse_from(&arguments) {
        Ok(cli) => {
            let output = Output::new(cli.json);
            let done = start_threads(cli.jobs).and_then(|()| cli.execute(&output));
            output.end(done)
        }
        // clap has read nothing: whether JSON is wanted must be seen in the words themselves.
        Err(error) => Output::new(arguments.iter().any(|a| a == "--json")).usage(&error),
    }
}

fn start_threads(jobs: Option<u16>) -> Result<(), CliError> {
    let Some(jobs) = jobs else { return Ok(()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs));
    pool.build_global()
        .map_err(|e| CliError::failure(format!("cannot start {jobs} threads: {e}")))
}
