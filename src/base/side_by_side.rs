//! Work whose time goes by elsewhere, several pieces at once.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// So many at once.
const AT_ONCE: usize = 8;

/// Does something with each of many, several at once, until one fails; gives what was found, in no order. On threads of its own: those of
/// the pool are for work that takes a processor.
///
/// # Errors
/// The first that is met.
pub fn side_by_side<T: Sync, F: Send, E: Send>(
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
            // What is pushed is pushed in one step: a panic elsewhere leaves a list that is right.
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
    let threads = items.len().min(AT_ONCE);
    std::thread::scope(|scope| {
        // Where the system gives no more threads, fewer do.
        for _ in 1..threads {
            if std::thread::Builder::new().spawn_scoped(scope, one).is_err() {
                break;
            }
        }
        one();
    });
    found.into_inner().unwrap_or_else(PoisonError::into_inner)
}
