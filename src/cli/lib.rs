//! The command line: one file per command. All commands print through one `Output` and fail with one error type, so
//! that exit codes and `--json` are the same everywhere.

#[macro_use]
mod examples;

mod accuracy;
mod arguments;
mod attach;
mod audit;
mod check;

mod cluster;
mod columns;
mod commands;
mod compare;
mod compared;
mod copy;
mod csv;
mod dag;
mod decisions;
mod diff;
mod doctor;
mod error;
mod explain;
mod export;
mod fit;
mod fsck;
mod gc;
mod init;
mod job;
mod local_build;
mod locate;
mod log;
mod measure;
mod measured_files;
mod model;
mod model_warnings;
mod neglected;
mod output;
mod pace;
mod pin;
mod pipeline;
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
mod results;
mod run;
mod run_log;
mod schema;
mod screen;
mod serve;
mod show;
mod side_results;
mod signals;
mod sketch;
mod snapshot;
mod solve;
mod statistics;
mod status;
mod summary;
mod sweep;
mod table;
mod text;
mod tone;
mod unpin;
mod upstream;
mod worker;
mod write;
mod yields;

use std::ffi::OsString;

use commands::{Cli, JOBS};
use output::Output;

use deaflow_base as base;
use deaflow_hdf as hdf;

pub use accuracy::{AccuracyRequest, MeasuredAccuracy, Networks, SolvedReference};
pub use arguments::accuracy as read_accuracy;
pub use decisions::decide;
pub use error::CliError;
pub use output::Exit;
pub use predict::{Model, Predictions};
pub use screen::screen;
pub use solve::{Analysed, Analysis, Computation, Equilibria, Frequencies, OutputTimes, SolveRequest, Solved};

/// Prepares what commands do at their start for a program that calls parts of them, as Python does. `words` start the
/// command line in a process of its own; `sources` is the digest of the sources of this build.
pub fn prepare(words: Vec<OsString>, sources: &str) {
    base::set_build(sources);
    base::set_own_command(words);
    hdf::set_reader(reader::command);
}

/// Returns the number of threads that the environment asks for; 0 for one per core.
///
/// # Errors
/// When it is not a number, or out of range.
pub fn threads() -> Result<usize, CliError> {
    Ok(usize::from(jobs(None)?.unwrap_or(0)))
}

/// Runs a command line and returns how it ended. `sources` is the digest of the sources of this build.
pub fn main(arguments: impl IntoIterator<Item = OsString>, sources: &str) -> Exit {
    base::set_build(sources);
    signals::prepare();
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    if arguments.get(1).is_some_and(|word| word == hdf::COMMAND) {
        return reader::execute();
    }
    hdf::set_reader(reader::command);
    // Found before clap reads the arguments, for its own errors.
    let colour = commands::colour_in(&arguments);
    match Cli::read(&arguments, colour) {
        Ok(cli) => {
            let output = Output::new(cli.global.json, cli.global.color);
            let started = jobs(cli.global.jobs).and_then(start_threads);
            output.end(started.and_then(|()| cli.execute(&output)))
        }
        Err(error) => Output::new(arguments.iter().any(|a| a == "--json"), colour).usage(&error),
    }
}

/// Returns the requested number of threads: the argument, or that of the environment.
fn jobs(given: Option<u16>) -> Result<Option<u16>, CliError> {
    let set = std::env::var_os(JOBS).filter(|value| given.is_none() && !value.is_empty());
    let Some(value) = set else { return Ok(given) };
    let refused = |allowed: String| CliError::bad_input(format!("{JOBS} is {value:?}")).help(allowed);
    commands::jobs(&value.to_string_lossy()).map(Some).map_err(refused)
}

/// The size of the stack of a thread in bytes: the default of the standard library.
pub const STACK: usize = 2 << 20;

/// Starts the thread pool. A pool that starts lazily panics if the system refuses more threads.
fn start_threads(jobs: Option<u16>) -> Result<(), CliError> {
    let refused = |why: String| {
        let threads = jobs.map_or("one thread per core".to_owned(), |jobs| format!("{jobs} threads"));
        CliError::failure(format!("cannot start {threads}: {why}")).help("use fewer threads: --jobs N")
    };
    // If starting threads used up all memory, the C library would end the process without a message.
    let mut stacks: Vec<u8> = Vec::new();
    let all = usize::from(jobs.unwrap_or(0)) * STACK;
    stacks.try_reserve_exact(all).map_err(|e| refused(e.to_string()))?;
    drop(std::hint::black_box(stacks));
    // Zero means one per core.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs.unwrap_or(0)));
    pool.stack_size(STACK)
        .build_global()
        .map_err(|e| refused(e.to_string()))
}
