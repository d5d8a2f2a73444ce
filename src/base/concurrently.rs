//! Runs work that waits for files or the network on several threads.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// The largest number of threads.
const MAX_THREADS: usize = 8;

/// Applies `work` to each item on several threads until one fails, and returns the results in no particular order. It
/// uses threads of its own, since those of the pool are for work that needs a processor.
///
/// # Errors
/// The first error of `work`.
pub fn concurrently<T: Sync, F: Send, E: Send>(
    items: &[T],
    work: impl Fn(&T) -> Result<Option<F>, E> + Sync,
) -> Result<Vec<F>, E> {
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let found = Mutex::new(Ok(Vec::new()));
    let one = || {
        while !failed.load(Ordering::Relaxed) {
            let Some(item) = items.get(next.fetch_add(1, Ordering::Relaxed)) else {
                break;
            };
            let done = work(item);
            // The list is valid even if another thread panicked.
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            match (done, &mut *found) {
                (Ok(Some(one)), Ok(all)) => all.push(one),
                (Err(error), Ok(_)) => {
                    failed.store(true, Ordering::Relaxed);
                    *found = Err(error);
                }
                _ => {}
            }
        }
    };
    let threads = items.len().min(MAX_THREADS);
    std::thread::scope(|scope| {
        // If the system cannot start more threads, fewer are enough.
        for _ in 1..threads {
            if std::thread::Builder::new().spawn_scoped(scope, one).is_err() {
                break;
            }
        }
        one();
    });
    found.into_inner().unwrap_or_else(PoisonError::into_inner)
}
