//! Runs work on all cores, or briefly on the thread of a call, while other threads of Python go on, until Ctrl-C.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::error::raised;
use deaflow::base::Interrupt;
use deaflow::cli::{self, CliError};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// The time between two looks at the signals of Python.
const PAUSE: Duration = Duration::from_millis(50);

/// The time in which work that is stopped can end, before it is left to itself: a factorisation of a large matrix,
/// which takes half a minute, checks no interrupt.
const GRACE: Duration = Duration::from_millis(500);

/// Threads for one call at a time.
struct Pool {
    threads: rayon::ThreadPool,
    /// Whether their work is to end.
    is_stopped: Arc<AtomicBool>,
    /// The process that started them: one that it forks has none of them.
    process: u32,
}

/// The pools that no call uses. Starting threads takes longer than the solution of a pattern.
static IDLE: Mutex<Vec<Pool>> = Mutex::new(Vec::new());

/// A single push or pop changes the list, so a panic elsewhere leaves a valid one.
fn idle() -> MutexGuard<'static, Vec<Pool>> {
    IDLE.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pool {
    fn start() -> Result<Self, CliError> {
        let is_stopped = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&is_stopped);
        let interrupt = Interrupt::when(move || flag.load(Ordering::Relaxed));
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(cli::threads()?)
            .stack_size(cli::STACK)
            .thread_name(|_| "deaflow".to_owned())
            .start_handler(move |_| interrupt.clone().watch())
            .build()
            .map_err(|why| CliError::failure(format!("cannot start threads: {why}")))?;
        Ok(Self {
            threads,
            is_stopped,
            process: std::process::id(),
        })
    }

    fn take() -> Result<Self, CliError> {
        loop {
            let Some(pool) = idle().pop() else {
                return Self::start();
            };
            if pool.process == std::process::id() {
                return Ok(pool);
            }
            // Its threads are those of another process: there is nobody to end them.
            std::mem::forget(pool);
        }
    }
}

/// Runs work on all cores and returns its result; an exception if a handler of a signal raises one, as that of Ctrl-C
/// does. The work then ends soon, and its result is dropped; work that does not end in [`GRACE`] goes on alone, with
/// its threads, up to its next check of an interrupt.
///
/// # Errors
/// That of the work or of a handler, or if the system starts no threads.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, CliError> + Send + 'static,
) -> PyResult<T> {
    let pool = Pool::take().map_err(|error| raised(py, &error))?;
    let (sender, receiver) = channel();
    pool.threads.spawn(move || {
        // Nobody waits for a computation that was left to itself.
        let _ = sender.send(catch_unwind(AssertUnwindSafe(work)));
    });
    let mut refused: Option<(PyErr, Instant)> = None;
    // What is sent is behind a lock, so that other threads of Python may be allowed to run.
    let receiver = Mutex::new(receiver);
    let done: Result<Result<T, CliError>, Box<dyn Any + Send>> = loop {
        let received = py.detach(|| {
            let receiver = receiver.lock().unwrap_or_else(PoisonError::into_inner);
            receiver.recv_timeout(PAUSE)
        });
        match received {
            Ok(done) => break done,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("the computation ended without a result"));
            }
            Err(RecvTimeoutError::Timeout) => {
                if let Err(raised) = py.check_signals() {
                    pool.is_stopped.store(true, Ordering::Relaxed);
                    refused.get_or_insert_with(|| (raised, Instant::now()));
                }
            }
        }
        // Its pool, which stays stopped, is used no more.
        if let Some((raised, _)) = refused.take_if(|(_, since)| since.elapsed() > GRACE) {
            return Err(raised);
        }
    };
    pool.is_stopped.store(false, Ordering::Relaxed);
    idle().push(pool);
    match (refused, done) {
        (Some((raised, _)), _) => Err(raised),
        (None, Ok(result)) => result.map_err(|error| raised(py, &error)),
        (None, Err(panic)) => resume_unwind(panic),
    }
}

/// A computation on the thread of its call.
struct OwnCall {
    /// When signals were last looked at.
    looked: Instant,
    /// What a handler of a signal has raised.
    raised: Option<PyErr>,
}

thread_local! {
    /// The innermost computation on this thread: a handler of a signal may begin another one.
    static OWN_CALL: RefCell<Option<OwnCall>> = const { RefCell::new(None) };
    static IS_WATCHING: Cell<bool> = const { Cell::new(false) };
}

/// Returns whether this is the main thread, the only one that handles signals, and whose stack the program chooses.
///
/// # Errors
/// That of Python.
pub fn is_main_thread(py: Python<'_>) -> PyResult<bool> {
    let threading = py.import("threading")?;
    let current = threading.call_method0("current_thread")?;
    Ok(current.is(threading.call_method0("main_thread")?))
}

/// Runs work that takes some milliseconds on this thread, the [main](is_main_thread) one, up to Ctrl-C: on a busy
/// machine other threads would begin late. The work must not start work for several threads, and must check interrupts
/// often.
///
/// # Errors
/// That of the work or of a handler.
pub fn run_here<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T, CliError> + Send) -> PyResult<T> {
    if !IS_WATCHING.replace(true) {
        Interrupt::when(is_own_call_stopped).watch();
    }
    let own = OwnCall {
        looked: Instant::now(),
        raised: None,
    };
    let outer = OWN_CALL.replace(Some(own));
    let done = py.detach(|| catch_unwind(AssertUnwindSafe(work)));
    let own = OWN_CALL.replace(outer);
    match (own.and_then(|own| own.raised), done) {
        (Some(raised), _) => Err(raised),
        (None, Ok(result)) => result.map_err(|error| raised(py, &error)),
        (None, Err(panic)) => resume_unwind(panic),
    }
}

/// Looks at the signals of Python from time to time; returns whether a handler has raised an exception.
fn is_own_call_stopped() -> bool {
    let known = OWN_CALL.with_borrow_mut(|own| match own {
        Some(own) if own.raised.is_none() && own.looked.elapsed() > PAUSE => {
            own.looked = Instant::now();
            None
        }
        own => Some(own.as_ref().is_some_and(|own| own.raised.is_some())),
    });
    known.unwrap_or_else(|| {
        let raised = Python::attach(|py| py.check_signals()).err();
        let is_stopped = raised.is_some();
        OWN_CALL.with_borrow_mut(|own| own.as_mut().map(|own| own.raised = raised));
        is_stopped
    })
}
