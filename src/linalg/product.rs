//! Matrix products.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};

/// Returns AB.
#[must_use]
pub fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    a * b
}

/// Computes `out = AB` in single precision, or `out += AB` with [`Accum::Add`].
pub fn product_into(out: MatMut<'_, f32>, accumulate: Accum, a: MatRef<'_, f32>, b: MatRef<'_, f32>) {
    matmul(out, accumulate, a, b, 1.0, Par::Seq);
}
