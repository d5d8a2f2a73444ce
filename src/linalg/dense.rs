//! Dense matrices in double precision.

use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{ColMut, Mat, Side};

/// Eigenvalues in ascending order, with orthonormal eigenvectors in the columns of a matrix.
pub struct Eigen {
    /// The eigenvalues.
    pub values: Vec<f64>,
    /// The eigenvectors.
    pub vectors: Mat<f64>,
}

/// Returns the eigenvalues and eigenvectors of a symmetric matrix from its lower triangle; `None` if the iteration does
/// not converge.
#[must_use]
pub fn eigen(matrix: &Mat<f64>) -> Option<Eigen> {
    let eigen = matrix.self_adjoint_eigen(Side::Lower).ok()?;
    Some(Eigen {
        values: eigen.S().column_vector().iter().copied().collect(),
        vectors: eigen.U().to_owned(),
    })
}

/// Returns L of A = LLᵀ for a symmetric matrix from its lower triangle; `None` if it is not positive definite.
#[must_use]
pub fn cholesky(matrix: &Mat<f64>) -> Option<Mat<f64>> {
    Some(matrix.llt(Side::Lower).ok()?.L().to_owned())
}

/// Returns A⁻¹b for a symmetric matrix from its lower triangle; `None` if it is not positive definite.
#[must_use]
pub fn solve_definite(matrix: &Mat<f64>, right: &[f64]) -> Option<Vec<f64>> {
    let factor = matrix.llt(Side::Lower).ok()?;
    let mut solution = right.to_vec();
    factor.solve_in_place(ColMut::from_slice_mut(&mut solution));
    Some(solution)
}

/// Returns A⁻¹ for a symmetric matrix from its lower triangle; `None` if it is not positive definite.
#[must_use]
pub fn inverse_definite(matrix: &Mat<f64>) -> Option<Mat<f64>> {
    Some(Llt::new(matrix.as_ref(), Side::Lower).ok()?.inverse())
}

/// Returns A⁻¹b by LU with partial pivoting; not finite if the matrix is singular.
#[must_use]
pub fn solve(matrix: &Mat<f64>, right: &[f64]) -> Vec<f64> {
    let mut solution = right.to_vec();
    matrix
        .partial_piv_lu()
        .solve_in_place(ColMut::from_slice_mut(&mut solution));
    solution
}

/// Returns A⁻¹ by LU with partial pivoting; not finite if the matrix is singular.
#[must_use]
pub fn inverse(matrix: &Mat<f64>) -> Mat<f64> {
    matrix.partial_piv_lu().inverse()
}

/// Replaces `v` by L⁻¹v for a lower triangular matrix.
pub fn solve_lower(factor: &Mat<f64>, v: &mut [f64]) {
    factor.solve_lower_triangular_in_place(ColMut::from_slice_mut(v));
}
