//! Divides the time of a run among stages that are built in parallel, so that their shares add up to it.

use std::collections::BTreeMap;
use std::time::SystemTime;

use super::provenance::Environment;

/// The running stages with their shares of the time so far, s.
#[derive(Default)]
pub struct TimeShares {
    shares: BTreeMap<usize, f64>,
    last: Option<SystemTime>,
}

impl TimeShares {
    /// Returns the number of running stages.
    pub fn len(&self) -> usize {
        self.shares.len()
    }

    /// Whether a stage is running.
    pub fn contains(&self, index: usize) -> bool {
        self.shares.contains_key(&index)
    }

    /// Returns the running stages.
    pub fn stages(&self) -> impl Iterator<Item = usize> + '_ {
        self.shares.keys().copied()
    }

    /// Starts a stage.
    pub fn begin(&mut self, index: usize, environment: &Environment) {
        self.divide_elapsed(environment);
        self.shares.insert(index, 0.0);
    }

    /// Ends a stage and returns its share.
    pub fn end(&mut self, index: usize, environment: &Environment) -> f64 {
        self.divide_elapsed(environment);
        self.shares.remove(&index).unwrap_or_default()
    }

    fn divide_elapsed(&mut self, environment: &Environment) {
        let now = (environment.clock)();
        let passed = self.last.and_then(|last| now.duration_since(last).ok());
        let each = passed.unwrap_or_default().as_secs_f64() / self.shares.len().max(1) as f64;
        self.shares.values_mut().for_each(|share| *share += each);
        self.last = Some(now);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::time::{Duration, UNIX_EPOCH};

    use super::*;

    static NOW: AtomicU64 = AtomicU64::new(0);

    fn environment() -> Environment {
        Environment {
            clock: || UNIX_EPOCH + Duration::from_secs(NOW.load(Ordering::SeqCst)),
            ..Environment::system()
        }
    }

    #[test]
    fn parts_add_up_to_the_time_that_went_by() {
        let (mut shares, environment) = (TimeShares::default(), environment());
        let pass = |seconds| NOW.fetch_add(seconds, Ordering::SeqCst);
        shares.begin(0, &environment);
        pass(10);
        shares.begin(1, &environment);
        pass(6);
        assert_eq!(shares.end(0, &environment), 13.0);
        pass(1);
        assert_eq!((shares.end(1, &environment), shares.len()), (4.0, 0));
        // What goes by while nothing is at work is nobody's.
        pass(100);
        shares.begin(2, &environment);
        pass(1);
        assert_eq!(shares.end(2, &environment), 1.0);
    }
}
