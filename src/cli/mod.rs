//! The command line: one file per command. Commands speak through one `Output` and fail with one error type, so
//! that exit codes and `--json` are the same everywhere.

mod accuracy;
mod arguments;
mod attach;
mod audit;
mod cells;
mod cluster;
mod commands;
mod copy;
mod csv;
mod dag;
mod diff;
mod doctor;
mod error;
mod explain;
mod export;
mod fsck;
mod gc;
mod history;
mod locate;
mod log;
mod model;
mod modes;
mod neglected;
mod output;
mod path;
mod pin;
mod plan;
mod predict;
mod progress;
mod pull;
mod push;
mod reader;
mod remote;
mod report;
mod response;
mod rows;
mod run;
mod run_log;
mod schema;
mod screen;
mod show;
mod side;
mod signals;
mod simulate;
mod solve;
mod statistics;
mod status;
mod sweep;
mod table;
mod unpin;
mod upstream;
mod worker;
mod write;

use std::ffi::OsString;

use clap::Parser;

use commands::Cli;
use error::CliError;
use output::Output;

use crate::hdf;

pub use output::Exit;

/// Runs a command line and says how it ended.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> Exit {
    signals::prepare();
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    if arguments.get(1).is_some_and(|word| word == hdf::COMMAND) {
        return reader::execute();
    }
    hdf::set_reader(reader::command);
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

/// Started here, since a pool that starts by itself panics where the system has no more threads to give.
fn start_threads(jobs: Option<u16>) -> Result<(), CliError> {
    // Zero stands for one per core.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs.unwrap_or(0)));
    pool.build_global().map_err(|e| {
        let threads = jobs.map_or("one thread per core".to_owned(), |jobs| format!("{jobs} threads"));
        CliError::failure(format!("cannot start {threads}: {e}")).help("--jobs N asks for fewer")
    })
}
