//! Linear least squares with unknowns that are not negative (Lawson and Hanson, Solving Least Squares Problems, 1974,
//! chapter 23), on the normal equations.

use deaflow_linalg::{Mat, solve_definite};

/// Returns the x ≥ 0 that minimises ½xᵀAx − bᵀx, for a positive definite or semidefinite A.
#[must_use]
pub fn non_negative(gram: &Mat<f64>, right: &[f64]) -> Vec<f64> {
    let count = right.len();
    let mut x = vec![0.0; count];
    let mut free: Vec<usize> = Vec::new();
    let mut refused = vec![false; count];
    for _ in 0..4 * count {
        let slope = |i: usize| right[i] - free.iter().map(|&j| gram[(i, j)] * x[j]).sum::<f64>();
        let ascent = |i: usize| slope(i) / gram[(i, i)].sqrt();
        let entering = (0..count)
            .filter(|i| !free.contains(i) && !refused[*i] && slope(*i) > 1e-12 * right[*i].abs())
            .max_by(|&a, &b| ascent(a).total_cmp(&ascent(b)));
        let Some(entering) = entering else { break };
        free.push(entering);
        let Some(()) = descend(gram, right, &mut x, &mut free) else {
            // Columns that depend on each other: the solution before stands.
            free.retain(|&i| i != entering);
            x[entering] = 0.0;
            refused[entering] = true;
            continue;
        };
        if !free.contains(&entering) {
            refused[entering] = true;
        }
    }
    x
}

/// Moves to the minimum of the free unknowns, and takes out those that reach zero first; `None` if the free columns
/// depend on each other.
fn descend(gram: &Mat<f64>, right: &[f64], x: &mut [f64], free: &mut Vec<usize>) -> Option<()> {
    while !free.is_empty() {
        let system = Mat::from_fn(free.len(), free.len(), |a, b| gram[(free[a], free[b])]);
        let reduced: Vec<f64> = free.iter().map(|&i| right[i]).collect();
        let target = solve_definite(&system, &reduced)?;
        let blocked = free.iter().zip(&target).filter(|(_, t)| **t <= 0.0);
        let part = blocked.map(|(&i, t)| x[i] / (x[i] - t)).fold(1.0, f64::min);
        let part = if part.is_finite() { part } else { 0.0 };
        for (&i, t) in free.iter().zip(&target) {
            x[i] += part * (t - x[i]);
        }
        if target.iter().all(|t| *t > 0.0) {
            return Some(());
        }
        let leaves: Vec<usize> = free
            .iter()
            .zip(&target)
            .filter(|(i, t)| **t <= 0.0 && x[**i] <= 1e-14 * t.abs())
            .map(|(&i, _)| i)
            .collect();
        for &i in &leaves {
            x[i] = 0.0;
        }
        free.retain(|i| !leaves.contains(i));
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::non_negative;
    use deaflow_linalg::Mat;

    /// The unconstrained minimum is (1.5, −0.5, 1); with x₁ = 0 it is (1, 0, 1).
    #[test]
    fn an_unknown_that_would_be_negative_is_zero() {
        let gram = Mat::from_fn(3, 3, |i, j| [[1.0, 1.0, 0.0], [1.0, 4.0, 0.0], [0.0, 0.0, 2.0]][i][j]);
        let x = non_negative(&gram, &[1.0, -0.5, 2.0]);
        assert!(
            (x[0] - 1.0).abs() < 1e-14 && x[1] == 0.0 && (x[2] - 1.0).abs() < 1e-14,
            "{x:?}"
        );
    }

    #[test]
    fn equal_columns_share_no_weight() {
        let gram = Mat::from_fn(2, 2, |_, _| 2.0);
        let x = non_negative(&gram, &[3.0, 3.0]);
        assert!((x[0] + x[1] - 1.5).abs() < 1e-12, "{x:?}");
    }
}
