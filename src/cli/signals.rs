//! What the system does to a process that asks for too much, turned into errors and exit codes.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::consts::{SIGABRT, SIGXFSZ};
use signal_hook::flag;

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
