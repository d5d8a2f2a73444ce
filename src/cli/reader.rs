//! `deaflow read-hdf5`: a process that reads foreign HDF5 files. Only this program starts it; it is not in the list of
//! commands.

use std::path::Path;
use std::process::Command;

use super::Exit;
use deaflow_base::{own_command, own_process};
use deaflow_hdf as hdf;

/// The path of the running program, which is valid even after its file was replaced.
const SELF: &str = "/proc/self/exe";

/// Returns the command that starts this process.
pub fn command() -> Command {
    let is_whole = own_command().is_ok_and(|words| words.len() == 1);
    let own = match is_whole && Path::new(SELF).exists() {
        true => Ok(Command::new(SELF)),
        false => own_process(),
    };
    let mut command = own.unwrap_or_else(|_| Command::new("deaflow"));
    command.arg(hdf::COMMAND);
    command
}

/// Serves until the parent process is done.
pub fn execute() -> Exit {
    match hdf::serve() {
        Ok(()) => Exit::Done,
        Err(error) => {
            eprintln!("error: `deaflow {}` is only for deaflow itself: {error}", hdf::COMMAND);
            Exit::BadInput
        }
    }
}
