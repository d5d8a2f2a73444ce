//! Whether a fitted law is stable over the stretches that were measured.
//!
//! Drucker's condition: the Hessian of the energy in (ln λ₁, ln λ₂) is positive definite. A nominal stress that falls
//! is stable in a test with prescribed stretch, but not under a dead load; it falls earlier.

use crate::deformation::Test;
use crate::law::Law;

/// Divisions of each side of the triangles on which the Hessian is examined.
const DIVISIONS: usize = 40;
/// Divisions of each path on which the slope of the stress is examined.
const STEPS: usize = 400;

/// The stability of a law.
#[derive(Clone, Debug, PartialEq)]
pub struct Stability {
    /// The smallest stretches (λ₁, λ₂) within the hull of the data at which Drucker's condition fails.
    pub unstable_at: Option<(f64, f64)>,
    /// Ranges of stretch over which the nominal stress falls, up to the largest stretch that matters.
    pub falling: Vec<(Test, f64, f64)>,
}

impl Stability {
    /// Examines a law over the hull of the deformations that tests reached, and its stress from the smallest to the
    /// largest stretch.
    #[must_use]
    pub fn new(law: &Law, reached: &[(Test, f64)], largest_stretch: f64) -> Self {
        let smallest = reached.iter().map(|(_, stretch)| *stretch).fold(1.0, f64::min);
        let falling = |test| {
            let ranges = falling_ranges(law, test, smallest, largest_stretch);
            ranges.into_iter().map(move |(from, to)| (test, from, to))
        };
        Self {
            unstable_at: unstable_at(law, reached),
            falling: Test::ALL.into_iter().flat_map(falling).collect(),
        }
    }

    /// Returns whether Drucker's condition holds.
    #[must_use]
    pub fn is_stable(&self) -> bool {
        self.unstable_at.is_none()
    }
}

/// Returns the ranges of stretch over which the nominal stress falls. Beyond a limit of extensibility it does not.
#[must_use]
pub fn falling_ranges(law: &Law, test: Test, from: f64, to: f64) -> Vec<(f64, f64)> {
    let falls = |l: f64| law.slope(test, l.exp()).is_some_and(|slope| slope < 0.0);
    let (from, to) = (from.ln(), to.ln());
    let at = |step: usize| from + (to - from) * step as f64 / STEPS as f64;
    let mut ranges = Vec::new();
    let mut start = falls(from).then_some(from);
    for (low, high) in (0..STEPS).map(|step| (at(step), at(step + 1))) {
        match (start, falls(high)) {
            (None, true) => start = Some(boundary(&falls, low, high)),
            (Some(begin), false) => {
                ranges.push((f64::exp(begin), f64::exp(boundary(&falls, low, high))));
                start = None;
            }
            _ => {}
        }
    }
    ranges.extend(start.map(|begin| (f64::exp(begin), f64::exp(to))));
    ranges
}

/// Returns where a condition changes between two points.
fn boundary(condition: &dyn Fn(f64) -> bool, mut low: f64, mut high: f64) -> f64 {
    let below = condition(low);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if condition(middle) == below {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Returns the smallest deformation within the hull of those reached at which Drucker's condition fails.
///
/// Paths are straight lines in the plane of logarithms, so the hull consists of the triangles of the undeformed state
/// and the ends of two paths.
fn unstable_at(law: &Law, reached: &[(Test, f64)]) -> Option<(f64, f64)> {
    let ends = ends_of_paths(reached);
    let mut first: Option<[f64; 2]> = None;
    let size = |[a, b]: [f64; 2]| a * a + a * b + b * b;
    for (index, one) in ends.iter().enumerate() {
        for other in &ends[index..] {
            for (i, j) in (0..=DIVISIONS).flat_map(|i| (0..=DIVISIONS - i).map(move |j| (i, j))) {
                let [s, t] = [i, j].map(|i| i as f64 / DIVISIONS as f64);
                let at = [s * one[0] + t * other[0], s * one[1] + t * other[1]];
                if !is_positive(law, at) && first.is_none_or(|first| size(at) < size(first)) {
                    first = Some(at);
                }
            }
        }
    }
    first.map(|[a, b]| (a.exp(), b.exp()))
}

/// Returns the ends of each path in tension and in compression, in the plane of logarithms.
fn ends_of_paths(reached: &[(Test, f64)]) -> Vec<[f64; 2]> {
    let mut ends = Vec::new();
    for test in Test::ALL {
        let logarithms = || {
            reached
                .iter()
                .filter(|(of, _)| *of == test)
                .map(|(_, stretch)| stretch.ln())
        };
        let [a, b] = test.path();
        for end in [logarithms().fold(0.0, f64::max), logarithms().fold(0.0, f64::min)] {
            if end != 0.0 {
                ends.push([a * end, b * end]);
            }
        }
    }
    ends
}

/// Returns whether the Hessian has a value and is positive definite.
fn is_positive(law: &Law, at: [f64; 2]) -> bool {
    law.hessian(at)
        .is_some_and(|[h11, h12, h22]| h11 > 0.0 && h11 * h22 - h12 * h12 > 0.0)
}

#[cfg(test)]
mod tests {
    use super::{Stability, falling_ranges};
    use crate::{Law, OgdenTerm, Test};

    /// From an independent program: roots of ∂P/∂λ.
    #[test]
    fn a_yeoh_law_falls_where_an_independent_program_says() {
        let law = Law::Yeoh {
            shear_modulus: 50.0,
            c2: -2.5,
            c3: 0.06,
        };
        let known = [
            (Test::Uniaxial, 1.88269607, 4.15037032),
            (Test::Equibiaxial, 1.43530379, 2.96992671),
            (Test::PureShear, 1.78659055, 4.07978262),
        ];
        for (test, from, to) in known {
            let ranges = falling_ranges(&law, test, 1.0, 6.0);
            assert_eq!(ranges.len(), 1, "{ranges:?}");
            assert!(
                (ranges[0].0 - from).abs() < 1e-8 && (ranges[0].1 - to).abs() < 1e-8,
                "{test:?}: {ranges:?}"
            );
        }
        let stability = Stability::new(&law, &[(Test::Uniaxial, 3.0), (Test::Equibiaxial, 1.2)], 3.0);
        assert!(!stability.is_stable());
        assert_eq!(stability.falling.len(), 3);
        assert!(Stability::new(&law, &[(Test::Uniaxial, 1.5)], 1.4).is_stable());
    }

    /// One term of Ogden's law is stable for every α > 0, but its uniaxial stress has a maximum:
    /// λ^(3α/2) = (1 + α/2)/(1 − α).
    #[test]
    fn the_stress_of_a_small_exponent_falls_although_the_law_is_stable() {
        let law = Law::Ogden(vec![OgdenTerm {
            shear_modulus: 1.0,
            alpha: 0.25,
        }]);
        let ranges = falling_ranges(&law, Test::Uniaxial, 1.0, 5.0);
        assert!((ranges[0].0 - 1.5_f64.powf(8.0 / 3.0)).abs() < 1e-9, "{ranges:?}");
        assert!(Stability::new(&law, &[(Test::Uniaxial, 5.0)], 5.0).is_stable());
    }
}
