//! How much work a pattern may take before it is given up.
//!
//! Stiffening laws have stable states far beyond the voltage at which other membranes snap, and the way there is long. Work is counted, not
//! timed, so that a result does not depend on the machine or on what else it does. The unit is an iteration of conjugate
//! gradients on the mesh at hand; on 50² biquadratic elements it takes 0.13 ms of one core under the base law, 0.27 ms where it stiffens by Gent's law
//! or a polynomial one or wrinkles, and 0.45 ms under Ogden's.

use deaflow_base::Time;

/// The time in s that [`WorkLimit::default`] stands for: an upper bound on those meshes, whatever the law.
pub const USUAL_SECONDS: f64 = 5.0;
/// Units in it: 1.3 s under the base law, 4.5 s under Ogden's.
const USUAL: u64 = 10_000;

/// A sweep over all points of the mesh under the law of the scene.
pub(super) const SWEEP: u64 = 3;
/// The factors of the tangent on the smallest mesh; they grow with the root of the number of unknowns.
const FACTORS: f64 = 300.0;
/// Numbers in a vector of that mesh.
const SMALLEST: f64 = 5e3;

/// The factors of the tangent on a mesh with vectors of this length.
pub(super) fn factors(len: usize) -> u64 {
    (FACTORS * (len as f64 / SMALLEST).sqrt()) as u64
}

/// How much work a pattern may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct WorkLimit(u64);

impl Default for WorkLimit {
    fn default() -> Self {
        Self(USUAL)
    }
}

impl WorkLimit {
    /// What is done in about this time in s, at most. The usual one is that of 5 s.
    #[must_use]
    pub fn of_seconds(seconds: f64) -> Self {
        Self((seconds / USUAL_SECONDS * USUAL as f64).ceil() as u64)
    }

    /// The same of a time; the usual limit where none is given.
    #[must_use]
    pub fn of_time(time: Option<&Time>) -> Self {
        time.map_or_else(Self::default, |time| Self::of_seconds(time.value()))
    }

    /// The same of a whole history: a hundred times the usual limit where none is given.
    #[must_use]
    pub fn of_history(time: Option<&Time>) -> Self {
        time.map_or(Self(100 * USUAL), |time| Self::of_seconds(time.value()))
    }

    /// A part of it.
    #[must_use]
    pub fn part(self, share: f64) -> Self {
        Self((share * self.0 as f64) as u64)
    }

    /// What is left of it after some work.
    #[must_use]
    pub fn less(self, spent: u64) -> Self {
        Self(self.0.saturating_sub(spent))
    }

    /// Whether so much work is too much.
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
        assert_eq!(WorkLimit::of_seconds(USUAL_SECONDS), WorkLimit::default());
        assert_eq!(WorkLimit::of_seconds(10.0), WorkLimit(2 * USUAL));
        let limit = WorkLimit::default().part(0.5).less(100);
        assert_eq!(limit, WorkLimit(USUAL / 2 - 100));
        assert!(limit.is_spent(USUAL / 2) && !limit.is_spent(USUAL / 2 - 101));
        assert!(WorkLimit(5).less(9).is_spent(0));
    }
}
