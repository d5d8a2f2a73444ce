//! Interrupts: a computation that nobody waits for ends early.
//!
//! A solver is called through searches, screening and audits, which need not know whether somebody waits for them. So
//! an interrupt belongs to the threads of a computation, as a signal belongs to a process, and the innermost loops
//! check it. An interrupted solver ends as if its work limit were reached; whoever interrupts it discards the result.

use std::cell::RefCell;
use std::fmt;
use std::sync::Arc;

thread_local! {
    static WATCHED: RefCell<Option<Interrupt>> = const { RefCell::new(None) };
}

/// A condition under which a computation ends.
#[derive(Clone)]
pub struct Interrupt(Arc<dyn Fn() -> bool + Send + Sync>);

impl Interrupt {
    /// Creates an interrupt that is raised while a condition holds. The condition is checked after each iteration of a
    /// solver, so it must be quick.
    pub fn when(condition: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(condition))
    }

    /// Returns whether it is raised.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        (self.0)()
    }

    /// Returns the one that this thread watches, for threads that it starts.
    #[must_use]
    pub fn watched() -> Option<Self> {
        WATCHED.with_borrow(Clone::clone)
    }

    /// Ends the computations of this thread from now on, once it is raised.
    pub fn watch(self) {
        WATCHED.set(Some(self));
    }
}

impl fmt::Debug for Interrupt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Interrupt").field(&self.is_raised()).finish()
    }
}

/// Returns whether the computation of this thread is interrupted; never on a thread that watches no interrupt.
#[must_use]
pub fn is_interrupted() -> bool {
    WATCHED.with_borrow(|watched| watched.as_ref().is_some_and(Interrupt::is_raised))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[test]
    fn an_interrupt_reaches_the_threads_that_watch_it() {
        let flag = Arc::new(AtomicBool::new(false));
        let condition = Arc::clone(&flag);
        let interrupt = Interrupt::when(move || condition.load(Ordering::Relaxed));
        let watching = std::thread::spawn(move || {
            interrupt.watch();
            let before = is_interrupted();
            flag.store(true, Ordering::Relaxed);
            let passed_on = Interrupt::watched().is_some_and(|watched| watched.is_raised());
            (before, is_interrupted(), passed_on)
        });
        assert_eq!(watching.join().unwrap(), (false, true, true));
        assert!(!is_interrupted(), "this thread watches nothing");
        assert!(Interrupt::watched().is_none());
    }
}
