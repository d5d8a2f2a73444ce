//! The limit of work for a pattern.
//!
//! Stiffening laws have stable states far beyond the critical voltages of other membranes, and many steps lead there.
//! Work is counted, not timed, so that a result does not depend on the machine or its load. The unit is an iteration of
//! conjugate gradients on the mesh; on 50² biquadratic elements it takes 0.13 ms of one core with the base law, 0.27 ms
//! with Gent's law, a polynomial law or wrinkling, and 0.45 ms with Ogden's law.

use deaflow_base::Time;

/// Nominal time of [`WorkLimit::default`] in s: an upper bound on that mesh for all laws.
pub const DEFAULT_SECONDS: f64 = 5.0;
/// Work in it: 1.3 s with the base law, 4.5 s with Ogden's.
const DEFAULT: u64 = 10_000;

/// Work of one pass over all points of the mesh.
pub(super) const SWEEP: u64 = 3;
/// Work of a factorisation of the tangent on the smallest mesh; it grows with the root of the number of unknowns.
const FACTORS: f64 = 300.0;
/// Length of a vector on that mesh.
const SMALLEST_LENGTH: f64 = 5e3;

/// Returns the work of a factorisation of the tangent for vectors of this length.
pub(super) fn factors(len: usize) -> u64 {
    (FACTORS * (len as f64 / SMALLEST_LENGTH).sqrt()) as u64
}

/// A limit of work for a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct WorkLimit(u64);

impl Default for WorkLimit {
    fn default() -> Self {
        Self(DEFAULT)
    }
}

impl WorkLimit {
    /// Returns the work of at most this time in s.
    #[must_use]
    pub fn of_seconds(seconds: f64) -> Self {
        Self((seconds / DEFAULT_SECONDS * DEFAULT as f64).ceil() as u64)
    }

    /// Returns the work of a time, or the default.
    #[must_use]
    pub fn of_time(time: Option<&Time>) -> Self {
        time.map_or_else(Self::default, |time| Self::of_seconds(time.value()))
    }

    /// Returns the work of a history: that of a time, or a hundred times the default.
    #[must_use]
    pub fn of_history(time: Option<&Time>) -> Self {
        time.map_or(Self(100 * DEFAULT), |time| Self::of_seconds(time.value()))
    }

    /// Returns a share of it.
    #[must_use]
    pub fn part(self, share: f64) -> Self {
        Self((share * self.0 as f64) as u64)
    }

    /// Returns the remaining limit after some work.
    #[must_use]
    pub fn less(self, spent: u64) -> Self {
        Self(self.0.saturating_sub(spent))
    }

    /// Returns whether this work reaches the limit.
    #[must_use]
    pub fn is_spent(self, work: u64) -> bool {
        work >= self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_proportional_to_its_time() {
        assert_eq!(WorkLimit::of_seconds(DEFAULT_SECONDS), WorkLimit::default());
        assert_eq!(WorkLimit::of_seconds(10.0), WorkLimit(2 * DEFAULT));
        let limit = WorkLimit::default().part(0.5).less(100);
        assert_eq!(limit, WorkLimit(DEFAULT / 2 - 100));
        assert!(limit.is_spent(DEFAULT / 2) && !limit.is_spent(DEFAULT / 2 - 101));
        assert!(WorkLimit(5).less(9).is_spent(0));
    }
}
