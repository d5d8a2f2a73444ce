//! What is in a store, counted anew from time to time: a page asks again and again, and counting looks at every file.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use super::kept::lock;
use crate::http::Refusal;
use deaflow_store::{Store, Totals};

/// The shortest time between two counts.
const PAUSE: Duration = Duration::from_secs(2);

/// Counting takes at most one in so many parts of the time.
const SHARE: u32 = 20;

/// The last count.
#[derive(Default)]
pub struct StoreTotals(Mutex<Option<Count>>);

struct Count {
    totals: Totals,
    /// Until then it serves.
    until: Instant,
}

impl StoreTotals {
    /// The totals of a store, of now or of a short while ago.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn of(&self, store: &Store) -> Result<Totals, Refusal> {
        let mut last = lock(&self.0);
        let began = Instant::now();
        if let Some(count) = last.as_ref().filter(|count| began < count.until) {
            return Ok(count.totals.clone());
        }
        let totals = store.totals()?;
        let pause = PAUSE.max(began.elapsed() * SHARE);
        *last = Some(Count {
            totals: totals.clone(),
            until: Instant::now() + pause,
        });
        Ok(totals)
    }
}
