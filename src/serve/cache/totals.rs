//! The totals of a store. Counting reads every file, and the page asks often, so the last count is reused for a while.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use super::lru::lock;
use crate::http::ApiError;
use deaflow_store::{Store, Totals};

/// The shortest time between two counts.
const PAUSE: Duration = Duration::from_secs(2);

/// Counting takes at most 1/20 of the time.
const PAUSE_FACTOR: u32 = 20;

/// The last count.
#[derive(Default)]
pub struct StoreTotals(Mutex<Option<Count>>);

struct Count {
    totals: Totals,
    /// The count is reused until then.
    until: Instant,
}

impl StoreTotals {
    /// Returns the totals of a store, at most a few seconds old.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn of(&self, store: &Store) -> Result<Totals, ApiError> {
        let mut last = lock(&self.0);
        let began = Instant::now();
        if let Some(count) = last.as_ref().filter(|count| began < count.until) {
            return Ok(count.totals.clone());
        }
        let totals = store.totals()?;
        let pause = PAUSE.max(began.elapsed() * PAUSE_FACTOR);
        *last = Some(Count {
            totals: totals.clone(),
            until: Instant::now() + pause,
        });
        Ok(totals)
    }
}
