//! Eigenvectors of a line of elements, which diagonalise the Laplacian of a rectangle along one direction.

use std::ops::Range;

use deaflow_linalg::{Eigen, Mat, eigen, product};

use super::element::Line;

/// Returns stiffness and mass of a line of elements at the interior nodes; `size` returns the length of an element.
pub fn line_matrices<const A: usize>(
    elements: usize,
    line: &Line<A>,
    size: impl Fn(usize) -> f64,
) -> (Mat<f64>, Mat<f64>) {
    matrices_at(1..elements * (A - 1), elements, line, size)
}

/// Returns stiffness and mass of a line of elements at these nodes.
pub fn matrices_at<const A: usize>(
    free: Range<usize>,
    elements: usize,
    line: &Line<A>,
    size: impl Fn(usize) -> f64,
) -> (Mat<f64>, Mat<f64>) {
    let degree = A - 1;
    let nodes = elements * degree + 1;
    let (mut stiffness, mut mass) = (Mat::zeros(nodes, nodes), Mat::zeros(nodes, nodes));
    for element in 0..elements {
        for (a, b) in (0..A * A).map(|i| (i / A, i % A)) {
            let at = (element * degree + a, element * degree + b);
            for q in 0..A {
                stiffness[at] += line.weights[q] * line.slopes[q][a] * line.slopes[q][b] / size(element);
                mass[at] += line.weights[q] * line.values[q][a] * line.values[q][b] * size(element);
            }
        }
    }
    let own = |m: Mat<f64>| m.submatrix(free.start, free.start, free.len(), free.len()).to_owned();
    (own(stiffness), own(mass))
}

/// Returns the even or odd eigenvectors of KQ = MQΛ with QᵀMQ = I, at the nodes up to the middle, and their
/// eigenvalues.
pub fn half_modes(stiffness: &Mat<f64>, mass: &Mat<f64>, odd: bool) -> Option<(Mat<f64>, Vec<f64>)> {
    let n = stiffness.nrows();
    let count = if odd { n / 2 } else { n.div_ceil(2) };
    let sign = if odd { -1.0 } else { 1.0 };
    // The basis is (eᵢ ± e₋ᵢ)/√2, and the middle node alone.
    let is_middle = |i: usize| n % 2 == 1 && i == n / 2;
    let norm = |i: usize| if is_middle(i) { 0.5 } else { 0.5_f64.sqrt() };
    let reduce = |m: &Mat<f64>| {
        let folded = |i: usize, k: usize| {
            m[(i, k)] + sign * m[(i, n - 1 - k)] + sign * m[(n - 1 - i, k)] + m[(n - 1 - i, n - 1 - k)]
        };
        Mat::from_fn(count, count, |i, k| norm(i) * norm(k) * folded(i, k))
    };
    let (vectors, values) = generalised_eigen(&reduce(stiffness), &reduce(mass))?;
    let scale = |i: usize| if is_middle(i) { 1.0 } else { 0.5_f64.sqrt() };
    Some((Mat::from_fn(count, count, |i, k| scale(i) * vectors[(i, k)]), values))
}

/// Returns eigenvectors Q and eigenvalues of KQ = MQΛ with QᵀMQ = I, by means of M^(−½).
pub(super) fn generalised_eigen(stiffness: &Mat<f64>, mass: &Mat<f64>) -> Option<(Mat<f64>, Vec<f64>)> {
    let n = mass.nrows();
    if n == 0 {
        return Some((Mat::new(), Vec::new()));
    }
    let Eigen { values: d, vectors: v } = eigen(mass)?;
    let scaled = Mat::from_fn(n, n, |i, k| v[(i, k)] / d[k].sqrt());
    let root = product(scaled.as_ref(), v.transpose());
    let reduced = product(product(root.as_ref(), stiffness.as_ref()).as_ref(), root.as_ref());
    let Eigen { values, vectors } = eigen(&reduced)?;
    Some((product(root.as_ref(), vectors.as_ref()), values))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_of_linear_elements_are_sines() {
        // KQ = MQΛ on a uniform line: q ∝ sin(kπi/n), λ = 6(1 − cos θ)/(2 + cos θ) with θ = kπ/n and unit elements.
        for (n, (odd, first)) in [10, 11].into_iter().flat_map(|n| [(n, (false, 1)), (n, (true, 2))]) {
            let (stiffness, mass) = line_matrices(n, &Line::LINEAR, |_| 1.0);
            let (vectors, values) = half_modes(&stiffness, &mass, odd).unwrap();
            for (mode, value) in values.iter().enumerate() {
                let theta = (first + 2 * mode) as f64 * std::f64::consts::PI / n as f64;
                let exact = 6.0 * (1.0 - theta.cos()) / (2.0 + theta.cos());
                assert!((value / exact - 1.0).abs() < 1e-12);
                let ratio = vectors[(0, mode)] / theta.sin();
                for i in 0..vectors.nrows() {
                    assert!((vectors[(i, mode)] - ratio * ((i + 1) as f64 * theta).sin()).abs() < 1e-12);
                }
            }
        }
    }
}
