//! What the system does to a process that asks for too much, turned into errors and exit codes.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use signal_hook::consts::{SIGABRT, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::flag;

use super::error::CliError;
use super::output::Exit;
use deaflow_base::{Background, Pauses};

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

/// A wish to stop, by the signals that ask for it.
pub struct Stop {
    flag: Arc<AtomicBool>,
    _watch: Option<Background>,
}

impl Stop {
    /// Heeds Ctrl-C and what batch systems send, and has them answered once, soon after they have come.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn heed(answer: impl FnOnce() + Send + 'static) -> Result<Self, CliError> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            heed(signal, &flag)?;
        }
        let asked = flag.clone();
        let watch = move |pauses: &Pauses| {
            while pauses.wait(PAUSE) {
                if asked.load(Ordering::Relaxed) {
                    return answer();
                }
            }
        };
        Ok(Self {
            flag,
            // Without the thread it stops all the same, and says nothing before that.
            _watch: Background::start("signals", watch).ok(),
        })
    }

    /// Set once it is wished.
    pub fn flag(&self) -> &AtomicBool {
        &self.flag
    }

    /// The work is over: whether it was to stop. From now on such a signal ends the process.
    pub fn end(self) -> bool {
        self.flag.swap(true, Ordering::Relaxed)
    }
}

/// Between two looks at whether it is wished to stop.
const PAUSE: Duration = Duration::from_millis(50);

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
