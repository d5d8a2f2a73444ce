//! Profile likelihood: how far a parameter can move while the others adapt.
//!
//! Unlike the interval of the covariance it holds where the model is not linear, and it may be open on one side.

use crate::least_squares::{Bounds, Minimum, Residuals, minimise};

/// The end of an interval is found to this, relative to its coordinate and to the first step.
const TOLERANCE: f64 = 1e-10;

/// Returns the range of coordinate `index` over which the least sum of squares of all others stays within `increase`
/// of the minimum; infinite where a bound is reached first. `first_step` is the expected half of the range.
#[must_use]
pub fn profile(
    residuals: &Residuals<'_>,
    bounds: &Bounds,
    best: &Minimum,
    index: usize,
    increase: f64,
    first_step: f64,
) -> (f64, f64) {
    let side = |sign: f64| {
        Side {
            residuals,
            bounds,
            index,
            allowed: best.sum_of_squares + increase,
            others: best.point.clone(),
        }
        .end(best.point[index], -increase, sign * first_step)
    };
    (side(-1.0), side(1.0))
}

/// The search on one side of the minimum.
struct Side<'a> {
    residuals: &'a Residuals<'a>,
    bounds: &'a Bounds,
    index: usize,
    allowed: f64,
    /// The last minimum of the other coordinates, where the next search starts.
    others: Vec<f64>,
}

impl Side<'_> {
    /// Returns the least sum of squares with the coordinate fixed, less what is allowed; infinite without a value.
    fn excess(&mut self, at: f64) -> f64 {
        let mut bounds = self.bounds.clone();
        bounds.lower[self.index] = at;
        bounds.upper[self.index] = at;
        match minimise(self.residuals, &self.others, &bounds) {
            Some(minimum) => {
                self.others = minimum.point;
                minimum.sum_of_squares - self.allowed
            }
            None => f64::INFINITY,
        }
    }

    /// Walks in growing steps until the sum of squares exceeds what is allowed, then narrows that step.
    fn end(mut self, start: f64, start_excess: f64, first_step: f64) -> f64 {
        let limits = (self.bounds.lower[self.index], self.bounds.upper[self.index]);
        let (mut inside, mut inside_excess, mut step) = (start, start_excess, first_step);
        let (outside, outside_excess) = loop {
            let at = (inside + step).clamp(limits.0, limits.1);
            let excess = self.excess(at);
            if excess > 0.0 {
                break (at, excess);
            }
            if at <= limits.0 || at >= limits.1 {
                return first_step.signum() * f64::INFINITY;
            }
            (inside, inside_excess, step) = (at, excess, 2.0 * step);
        };
        self.narrow(
            (inside, inside_excess),
            (outside, outside_excess),
            TOLERANCE * first_step.abs(),
        )
    }

    /// Finds the root by the Illinois method, and by bisection where the excess is infinite.
    fn narrow(&mut self, mut inside: (f64, f64), mut outside: (f64, f64), tolerance: f64) -> f64 {
        let mut last_was_inside = None;
        for _ in 0..200 {
            let (width, (a, fa), (b, fb)) = (outside.0 - inside.0, inside, outside);
            if width.abs() <= tolerance + TOLERANCE * 1e-3 * a.abs() {
                break;
            }
            let at = if fb.is_finite() {
                a - fa * (b - a) / (fb - fa)
            } else {
                0.5 * (a + b)
            };
            let excess = self.excess(at);
            let is_inside = excess <= 0.0;
            let repeated = last_was_inside == Some(is_inside);
            last_was_inside = Some(is_inside);
            if is_inside {
                inside = (at, excess);
                outside.1 *= if repeated { 0.5 } else { 1.0 };
            } else {
                outside = (at, excess);
                inside.1 *= if repeated { 0.5 } else { 1.0 };
            }
            if excess == 0.0 {
                break;
            }
        }
        inside.0
    }
}

#[cfg(test)]
mod tests {
    use super::profile;
    use crate::least_squares::{Bounds, Evaluation, minimise};
    use deaflow_linalg::Mat;

    /// r = (x − 1)/0.5 + y, y: with y free, r² = 2(x − 1)²; it is 3.92 at x = 1 ± 1.4.
    #[test]
    fn a_linear_model_has_the_interval_of_its_covariance() {
        let residuals = |q: &[f64]| {
            Some(Evaluation {
                residual: vec![2.0 * (q[0] - 1.0) + q[1], q[1]],
                jacobian: Mat::from_fn(2, 2, |i, j| [[2.0, 1.0], [0.0, 1.0]][i][j]),
            })
        };
        let bounds = Bounds {
            lower: vec![-9.0, -9.0],
            upper: vec![2.0, 9.0],
        };
        let best = minimise(&residuals, &[0.0, 1.0], &bounds).unwrap();
        let (low, high) = profile(&residuals, &bounds, &best, 0, 3.92, 1.0);
        assert!((low + 0.4).abs() < 1e-9 && high == f64::INFINITY, "{low} {high}");
    }
}
