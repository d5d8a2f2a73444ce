//! What the system does to a process that asks for too much, turned into errors and exit codes.

use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::consts::{SIGABRT, SIGXFSZ};
use signal_hook::flag;

use super::error::CliError;
use super::output::Exit;

/// A file that grows past a limit is an error of its write, as on a full disk, and where memory is short the process ends with the
/// exit code of a failure after the standard library has said so. Where the system refuses, its own way stays.
pub fn prepare() {
    // Only that the signal has a handler matters: the write that raised it then fails.
    let _ = flag::register(SIGXFSZ, Arc::default());
    // An allocation that fails aborts: nothing can be undone, and nothing that is visible is half-done.
    let code = i32::from(Exit::Failure.code());
    let _ = flag::register_conditional_shutdown(SIGABRT, code, Arc::new(AtomicBool::new(true)));
}

/// Has a signal set a flag. Who sends it again does not want to wait: the process ends then, to be tried again.
///
/// # Errors
/// When the system refuses.
pub fn heed(signal: i32, flag: &Arc<AtomicBool>) -> Result<(), CliError> {
    let code = i32::from(Exit::TryAgain.code());
    flag::register_conditional_shutdown(signal, code, flag.clone()).map_err(unheard)?;
    flag::register(signal, flag.clone()).map_err(unheard)?;
    Ok(())
}

/// Has a signal end nothing.
///
/// # Errors
/// When the system refuses.
pub fn ignore(signal: i32) -> Result<(), CliError> {
    flag::register(signal, Arc::default()).map_err(unheard)?;
    Ok(())
}

fn unheard(error: io::Error) -> CliError {
    CliError::failure(format!("signals cannot be heeded: {error}"))
}
