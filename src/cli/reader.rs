//! `deaflow read-hdf5`: the process that reads HDF5 files of others. Only this program starts it, and it is in no list of
//! commands.

use std::path::Path;
use std::process::Command;

use super::Exit;
use deaflow_hdf as hdf;

/// Where the system shows the running program, even when its file has been replaced by another build.
const SELF: &str = "/proc/self/exe";

/// This program, to be run as that process.
pub fn command() -> Command {
    let own = match Path::new(SELF).exists() {
        true => SELF.into(),
        false => std::env::current_exe().unwrap_or_else(|_| "deaflow".into()),
    };
    let mut command = Command::new(own);
    command.arg(hdf::COMMAND);
    command
}

/// Serves until the process that has started this one is done.
pub fn execute() -> Exit {
    match hdf::serve() {
        Ok(()) => Exit::Done,
        Err(error) => {
            eprintln!("error: `deaflow {}` is only for deaflow itself: {error}", hdf::COMMAND);
            Exit::BadInput
        }
    }
}
