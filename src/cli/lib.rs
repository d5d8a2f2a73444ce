//! The command line: one file per command. Commands speak through one `Output` and fail with one error type, so
//! that exit codes and `--json` are the same everywhere.

mod accuracy;
mod arguments;
mod attach;
mod audit;
mod cells;
mod cluster;
mod columns;
mod commands;
mod completions;
mod copy;
mod csv;
mod dag;
mod diff;
mod doctor;
mod ending;
mod error;
mod examples;
mod explain;
mod export;
mod fsck;
mod gc;
mod history;
mod init;
mod locate;
mod log;
mod man;
mod model;
mod modes;
mod neglected;
mod outcomes;
mod output;
mod pace;
mod path;
mod pin;
mod plan;
mod point;
mod predict;
mod progress;
mod project;
mod pull;
mod push;
mod reader;
mod remote;
mod report;
mod response;
mod run;
mod run_log;
mod schema;
mod screen;
mod serve;
mod show;
mod side;
mod signals;
mod simulate;
mod sketch;
mod solve;
mod statistics;
mod status;
mod sweep;
mod table;
mod text;
mod tone;
mod unpin;
mod upstream;
mod worker;
mod write;

use std::ffi::OsString;

use commands::{Cli, JOBS};
use error::CliError;
use output::Output;

use deaflow_base as base;
use deaflow_hdf as hdf;

pub use output::Exit;

/// Runs a command line and says how it ended.
/// The digest of the sources names this build.
pub fn main(arguments: impl IntoIterator<Item = OsString>, sources: &str) -> Exit {
    base::set_build(sources);
    signals::prepare();
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    if arguments.get(1).is_some_and(|word| word == hdf::COMMAND) {
        return reader::execute();
    }
    hdf::set_reader(reader::command);
    // Before clap has read anything: what it has to say is said in the form that is asked for, too.
    let colour = commands::colour_in(&arguments);
    match Cli::read(&arguments, colour) {
        Ok(cli) => {
            let output = Output::new(cli.global.json, cli.global.color);
            let done = jobs(cli.global.jobs).and_then(start_threads);
            output.end(done.and_then(|()| cli.execute(&output)))
        }
        Err(error) => Output::new(arguments.iter().any(|a| a == "--json"), colour).usage(&error),
    }
}

/// The threads that are asked for, here or in the environment.
fn jobs(given: Option<u16>) -> Result<Option<u16>, CliError> {
    let set = std::env::var_os(JOBS).filter(|value| given.is_none() && !value.is_empty());
    let Some(value) = set else { return Ok(given) };
    let refused = |allowed: String| CliError::bad_input(format!("{JOBS} is {value:?}")).help(allowed);
    commands::jobs(&value.to_string_lossy()).map(Some).map_err(refused)
}

/// Bytes of the stack of a thread, as many as the standard library gives.
const STACK: usize = 2 << 20;

/// Started here, since a pool that starts by itself panics where the system has no more threads to give.
fn start_threads(jobs: Option<u16>) -> Result<(), CliError> {
    let refused = |why: String| {
        let threads = jobs.map_or("one thread per core".to_owned(), |jobs| format!("{jobs} threads"));
        CliError::failure(format!("cannot start {threads}: {why}")).help("--jobs N asks for fewer")
    };
    // Where threads use up all memory while they start, the C library ends the process before anything is said.
    let mut stacks: Vec<u8> = Vec::new();
    let all = usize::from(jobs.unwrap_or(0)) * STACK;
    stacks.try_reserve_exact(all).map_err(|e| refused(e.to_string()))?;
    drop(std::hint::black_box(stacks));
    // Zero stands for one per core.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs.unwrap_or(0)));
    pool.stack_size(STACK)
        .build_global()
        .map_err(|e| refused(e.to_string()))
}
