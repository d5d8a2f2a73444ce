//! The places of requests that simulate. One is kept for quick simulations, which do not wait for slow ones.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use deaflow_base::Interrupt;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Requests that simulate at a time.
pub const PLACES: usize = 4;

/// The queue that a request waits in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    /// Requests that only read.
    Reading,
    /// Requests that simulate for a short time, which have a place of their own.
    Quick,
    /// Requests that simulate: all places but one.
    Simulating,
}

/// The free places.
pub struct Places {
    quick: Arc<Semaphore>,
    all: Arc<Semaphore>,
}

impl Default for Places {
    fn default() -> Self {
        Self {
            quick: Arc::new(Semaphore::new(1)),
            all: Arc::new(Semaphore::new(PLACES - 1)),
        }
    }
}

impl Places {
    /// Waits for a place; `None` for requests that need none.
    pub async fn take(&self, lane: Lane) -> Option<OwnedSemaphorePermit> {
        match lane {
            Lane::Reading => None,
            Lane::Quick => match Arc::clone(&self.all).try_acquire_owned() {
                Ok(free) => Some(free),
                Err(_) => Arc::clone(&self.quick).acquire_owned().await.ok(),
            },
            Lane::Simulating => Arc::clone(&self.all).acquire_owned().await.ok(),
        }
    }
}

/// The client of a request: it leaves when this is dropped.
#[derive(Default)]
pub struct Client(Arc<AtomicBool>);

impl Client {
    /// Returns an interrupt that is raised once the client has left.
    pub fn left(&self) -> Interrupt {
        let left = Arc::clone(&self.0);
        Interrupt::when(move || left.load(Ordering::Relaxed))
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
