//! A background thread that ends when its handle is dropped.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

/// A background thread. Dropping this ends it at its next pause and waits for it.
pub struct Background {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

/// The pauses of the thread.
pub struct Pauses(Receiver<()>);

impl Pauses {
    /// Waits for a time, or until the thread must end. Returns whether the thread continues.
    #[must_use]
    pub fn wait(&self, time: Duration) -> bool {
        self.0.recv_timeout(time) == Err(RecvTimeoutError::Timeout)
    }
}

impl Background {
    /// Starts a thread with a name.
    ///
    /// # Errors
    /// When the system cannot start a thread.
    pub fn start(name: &str, work: impl FnOnce(&Pauses) + Send + 'static) -> io::Result<Self> {
        let (end, ended) = channel();
        let thread = Builder::new().name(name.to_owned());
        Ok(Self {
            thread: Some(thread.spawn(move || work(&Pauses(ended)))?),
            end: Some(end),
        })
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            // The panic of the thread has been printed.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Instant;

    use super::*;

    #[test]
    fn a_background_thread_ends_when_it_is_dropped() {
        let count = Arc::new(AtomicUsize::new(0));
        let counted = count.clone();
        let background = Background::start("count", move |pauses| {
            while pauses.wait(Duration::from_millis(1)) {
                counted.fetch_add(1, Ordering::SeqCst);
            }
        });
        while count.load(Ordering::SeqCst) < 3 {
            std::thread::yield_now();
        }
        drop(background.unwrap());
        let (ended, start) = (count.load(Ordering::SeqCst), Instant::now());
        let waits = Background::start("wait", |pauses| assert!(!pauses.wait(Duration::from_secs(600))));
        drop(waits.unwrap());
        assert!(start.elapsed() < Duration::from_secs(300));
        assert_eq!(count.load(Ordering::SeqCst), ended);
    }
}
