//! Small dense systems with symmetric positive definite matrices, in one fixed order of operations.

/// The lower factor of a symmetric positive definite matrix of n × n values, row by row.
pub(super) struct Cholesky {
    n: usize,
    lower: Vec<f64>,
}

impl Cholesky {
    /// The factor; pivots that rounding has taken to zero or below count as the smallest that double precision can tell from
    /// zero beside the diagonal.
    pub(super) fn new(n: usize, matrix: &[f64]) -> Self {
        let mut lower = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let (row, other) = (&lower[i * n..i * n + j], &lower[j * n..j * n + j]);
                let rest = matrix[i * n + j] - row.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
                lower[i * n + j] = if i == j {
                    rest.max(f64::EPSILON * matrix[i * n + i].abs())
                        .max(f64::MIN_POSITIVE)
                        .sqrt()
                } else {
                    rest / lower[j * n + j]
                };
            }
        }
        Self { n, lower }
    }

    /// The factor from its values.
    pub(super) fn from_lower(n: usize, lower: Vec<f64>) -> Self {
        Self { n, lower }
    }

    /// The values of the factor.
    pub(super) fn lower(&self) -> &[f64] {
        &self.lower
    }

    /// L⁻¹ v: for a covariance this makes coordinates that are uncorrelated and of variance 1.
    pub(super) fn whiten(&self, v: &[f64]) -> Vec<f64> {
        let n = self.n;
        let mut solved: Vec<f64> = Vec::with_capacity(n);
        for (i, value) in v.iter().enumerate().take(n) {
            let known = self.lower[i * n..i * n + i].iter().zip(&solved);
            let rest = value - known.map(|(a, b)| a * b).sum::<f64>();
            solved.push(rest / self.lower[i * n + i]);
        }
        solved
    }

    /// The solution of L Lᵀ x = v.
    pub(super) fn solve(&self, v: &[f64]) -> Vec<f64> {
        let n = self.n;
        let mut x = self.whiten(v);
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|j| self.lower[j * n + i] * x[j]).sum();
            x[i] = (x[i] - known) / self.lower[i * n + i];
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_are_solved() {
        let matrix = [4.0, 2.0, 0.6, 2.0, 5.0, 1.5, 0.6, 1.5, 3.0];
        let x = [1.0, -2.0, 0.5];
        let v: Vec<f64> = matrix
            .chunks(3)
            .map(|row| row.iter().zip(&x).map(|(a, b)| a * b).sum())
            .collect();
        let factor = Cholesky::new(3, &matrix);
        let found = factor.solve(&v);
        assert!(found.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-14), "{found:?}");
        // |L⁻¹v|² = vᵀ A⁻¹ v.
        let length: f64 = factor.whiten(&v).iter().map(|w| w * w).sum();
        let expected: f64 = v.iter().zip(&x).map(|(a, b)| a * b).sum();
        assert!((length - expected).abs() < 1e-13);
    }
}
