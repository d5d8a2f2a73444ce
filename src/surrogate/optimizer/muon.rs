//! Muon: momentum with all singular values set to about 1 (Jordan et al., "Muon: an optimizer for hidden layers in
//! neural networks", 2024, kellerjordan.github.io/posts/muon).
//!
//! The step is scaled to the usual size of Adam's (Liu et al., "Muon is scalable for LLM training", arXiv 2502.16982,
//! eq. 4), so that both rules share one learning rate. candle-nn has no Muon.

use deaflow_linalg::Accum;

use crate::layers::{Matrix, multiply};

/// Decay of the momentum.
const MOMENTUM: f32 = 0.95;
/// Root mean square of an entry of Adam's usual direction.
const ADAM_SIZE: f32 = 0.2;
/// The odd polynomial ax + bx³ + cx⁵, whose iteration maps singular values in (0, 1] to about 1.
const QUINTIC: [f32; 3] = [3.4445, -4.7750, 2.0315];
/// Number of iterations.
const ITERATIONS: usize = 5;

/// The momentum of one matrix.
pub(super) struct MuonState {
    momentum: Vec<f32>,
    rows: usize,
    columns: usize,
}

impl MuonState {
    /// Creates the state before the first step, for a matrix of this shape.
    pub(super) fn new(rows: usize, columns: usize) -> Self {
        Self {
            momentum: vec![0.0; rows * columns],
            rows,
            columns,
        }
    }

    /// Returns the momentum, row by row.
    pub(super) fn momentum(&self) -> &[f32] {
        &self.momentum
    }

    /// Restores the momentum.
    pub(super) fn resume(&mut self, momentum: Vec<f32>) {
        self.momentum = momentum;
    }

    /// Returns the descent direction.
    pub(super) fn direction(&mut self, gradient: &[f32]) -> Vec<f32> {
        let ahead = self.momentum.iter_mut().zip(gradient).map(|(m, g)| {
            *m = MOMENTUM * *m + g;
            g + MOMENTUM * *m
        });
        let mut direction: Vec<f32> = ahead.collect();
        orthogonalize(&mut direction, self.rows, self.columns);
        let scale = ADAM_SIZE * (self.rows.max(self.columns) as f32).sqrt();
        direction.iter_mut().for_each(|d| *d *= scale);
        direction
    }
}

/// Replaces a matrix U Σ Vᵀ by about U Vᵀ. A zero matrix stays zero.
fn orthogonalize(matrix: &mut [f32], rows: usize, columns: usize) {
    let norm = matrix.iter().map(|v| v * v).sum::<f32>().sqrt();
    if norm == 0.0 {
        return;
    }
    matrix.iter_mut().for_each(|v| *v /= norm);
    let wide = rows <= columns;
    let small = rows.min(columns);
    let [a, b, c] = QUINTIC;
    let (mut gram, mut polynomial) = (vec![0.0; small * small], vec![0.0; small * small]);
    let mut product = vec![0.0; matrix.len()];
    for _ in 0..ITERATIONS {
        let x = Matrix::new(matrix, columns);
        let (left, right) = if wide { (x, x.transposed()) } else { (x.transposed(), x) };
        multiply(&mut gram, Accum::Replace, left, right);
        let square = Matrix::new(&gram, small);
        multiply(&mut polynomial, Accum::Replace, square, square);
        polynomial.iter_mut().zip(&gram).for_each(|(p, g)| *p = b * g + c * *p);
        let p = Matrix::new(&polynomial, small);
        let (left, right) = if wide { (p, x) } else { (x, p) };
        multiply(&mut product, Accum::Replace, left, right);
        matrix.iter_mut().zip(&product).for_each(|(x, y)| *x = a * *x + y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::Stream;
    use deaflow_linalg::{Mat, eigen};

    /// The square roots of the eigenvalues of XXᵀ or XᵀX, of which the smaller is taken.
    fn singular_values(matrix: &[f32], rows: usize, columns: usize) -> Vec<f64> {
        let (count, length) = (rows.min(columns), rows.max(columns));
        let (step, along) = if rows <= columns { (columns, 1) } else { (1, columns) };
        let at = |line: usize, k: usize| f64::from(matrix[line * step + k * along]);
        let gram = Mat::from_fn(count, count, |i, j| (0..length).map(|k| at(i, k) * at(j, k)).sum());
        eigen(&gram).unwrap().values.into_iter().map(f64::sqrt).collect()
    }

    #[test]
    fn singular_values_become_about_one_and_directions_stay() {
        for (rows, columns) in [(4, 9), (9, 4), (1, 5), (3, 3)] {
            let mut stream = Stream::new(3, "muon test", rows as u64);
            let original: Vec<f32> = (0..rows * columns).map(|_| stream.normal() as f32).collect();
            let mut matrix = original.clone();
            orthogonalize(&mut matrix, rows, columns);
            let values = singular_values(&matrix, rows, columns);
            // The quintic ends between 0.68 and 1.13 (Jordan et al.).
            assert!(values.iter().all(|v| (0.6..1.25).contains(v)), "{values:?}");
            // ⟨M, UVᵀ⟩ is the sum of the singular values of M: the step descends in every direction.
            let dot: f32 = original.iter().zip(&matrix).map(|(a, b)| a * b).sum();
            let sum: f64 = singular_values(&original, rows, columns).iter().sum();
            assert!((0.6..1.25).contains(&(f64::from(dot) / sum)));
        }
    }

    #[test]
    fn a_zero_gradient_gives_a_zero_step() {
        assert_eq!(MuonState::new(2, 3).direction(&[0.0; 6]), [0.0; 6]);
    }
}
