//! Simulations for a request: they end when its client leaves, or after a time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::http::ApiError;
use deaflow_base::Interrupt;

/// Time limit of the simulations for a request.
pub const TIME_LIMIT: Duration = Duration::from_secs(120);

/// Largest number of threads for a request.
const MAX_THREADS: usize = 8;

/// Runs work on threads of its own, which an interrupt ends.
///
/// # Errors
/// If the system starts no threads.
pub fn interruptible<T: Send>(interrupt: &Interrupt, work: impl FnOnce() -> T + Send) -> Result<T, ApiError> {
    let interrupt = interrupt.clone();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(rayon::current_num_threads().min(MAX_THREADS))
        .thread_name(|_| "simulate".to_owned())
        .start_handler(move |_| interrupt.clone().watch())
        .build();
    let pool = pool.map_err(|error| ApiError::new(503, format!("cannot start threads: {error}")))?;
    Ok(pool.install(work))
}

/// Runs the work of a request until its client leaves, at most for a time.
///
/// # Errors
/// Those of the work, and if it was ended before.
pub fn limited<T: Send>(
    left: &Interrupt,
    limit: Duration,
    work: impl FnOnce() -> Result<T, ApiError> + Send,
) -> Result<T, ApiError> {
    let (left, start) = (left.clone(), Instant::now());
    let was_ended = Arc::new(AtomicBool::new(false));
    let ended = Arc::clone(&was_ended);
    let interrupt = Interrupt::when(move || {
        let ends = left.is_raised() || start.elapsed() >= limit;
        if ends {
            ended.store(true, Ordering::Relaxed);
        }
        ends
    });
    let found = interruptible(&interrupt, work)?;
    // The result of an interrupted simulation is no result.
    match was_ended.load(Ordering::Relaxed) {
        true => Err(ApiError::new(
            422,
            format!("the simulation was stopped after {} s, the limit", limit.as_secs()),
        )
        .help("use a coarser mesh, or `deaflow solve`")),
        false => found,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::is_interrupted;

    fn spin() -> Result<u8, ApiError> {
        while !is_interrupted() {
            std::thread::yield_now();
        }
        Ok(1)
    }

    #[test]
    fn work_ends_when_the_client_leaves_or_after_the_limit() {
        let never = Interrupt::when(|| false);
        let late = limited(&never, Duration::from_millis(5), spin).unwrap_err();
        assert_eq!(late.status, 422);
        let gone = Interrupt::when(|| true);
        assert!(limited(&gone, Duration::MAX, spin).is_err());
        assert_eq!(limited(&never, Duration::MAX, || Ok(3)).unwrap(), 3);
        let refused = limited::<u8>(&never, Duration::MAX, || Err(ApiError::new(400, "invalid")));
        assert_eq!(refused.unwrap_err().status, 400);
    }
}
