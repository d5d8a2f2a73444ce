//! Signals of the system, turned into errors, exit codes and requests to stop.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use signal_hook::consts::{SIGABRT, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::flag;

use super::{CliError, Exit};
use deaflow_base::{Background, Pauses};

/// Makes a file that exceeds a size limit an error of its write, as on a full disk, and ends the process with the exit
/// code
/// of a failure when memory is exhausted. If the system refuses, the defaults remain.
pub fn prepare() {
    // With any handler, the write that raised the signal fails instead of ending the process.
    let _ = flag::register(SIGXFSZ, Arc::default());
    // A failed allocation aborts; visible files are complete at any time.
    let code = i32::from(Exit::Failure.code());
    let _ = flag::register_conditional_shutdown(SIGABRT, code, Arc::new(AtomicBool::new(true)));
}

/// Makes a signal set a flag. The second signal ends the process, with the exit code for trying again.
///
/// # Errors
/// When the system refuses.
pub fn set_on(signal: i32, flag: &Arc<AtomicBool>) -> Result<(), CliError> {
    let code = i32::from(Exit::TryAgain.code());
    flag::register_conditional_shutdown(signal, code, flag.clone()).map_err(not_handled)?;
    flag::register(signal, flag.clone()).map_err(not_handled)?;
    Ok(())
}

/// A request to stop by SIGINT or SIGTERM.
pub struct Stop {
    flag: Arc<AtomicBool>,
    _watch: Option<Background>,
}

impl Stop {
    /// Handles Ctrl-C and the signal of batch systems; calls `answer` once, soon after the first signal.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn on_signals(answer: impl FnOnce() + Send + 'static) -> Result<Self, CliError> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            set_on(signal, &flag)?;
        }
        let requested = flag.clone();
        let watch = move |pauses: &Pauses| {
            while pauses.wait(PAUSE) {
                if requested.load(Ordering::Relaxed) {
                    return answer();
                }
            }
        };
        Ok(Self {
            flag,
            // Without the thread there is no answer, but the flag is set.
            _watch: Background::start("signals", watch).ok(),
        })
    }

    /// Returns the flag, which is set by the first signal.
    pub fn flag(&self) -> &AtomicBool {
        &self.flag
    }

    /// Ends the handling: returns whether a stop was requested. From now on the first signal ends the process.
    pub fn end(self) -> bool {
        self.flag.swap(true, Ordering::Relaxed)
    }
}

/// The time between two checks of the flag.
const PAUSE: Duration = Duration::from_millis(50);

/// Ignores a signal.
///
/// # Errors
/// When the system refuses.
pub fn ignore(signal: i32) -> Result<(), CliError> {
    flag::register(signal, Arc::default()).map_err(not_handled)?;
    Ok(())
}

fn not_handled(error: io::Error) -> CliError {
    CliError::failure(format!("cannot handle signals: {error}"))
}
