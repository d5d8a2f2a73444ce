//! Row-major matrix products on one thread.
//!
//! candle splits products over all threads of the machine. This crate runs patterns in parallel instead and computes
//! each product on one thread, always in the same order: results have the same bits for any number of threads, and no
//! product is too small to split.

use deaflow_linalg::{Accum, MatMut, MatRef, product_into};

/// A row-major matrix, or the transpose of one.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a> {
    view: MatRef<'a, f32>,
}

impl<'a> Matrix<'a> {
    /// Creates a view of a matrix with rows of `columns` values.
    pub(crate) fn new(values: &'a [f32], columns: usize) -> Self {
        let view = MatRef::from_row_major_slice(values, values.len() / columns, columns);
        Self { view }
    }

    /// Returns the transpose.
    pub(crate) fn transposed(self) -> Self {
        Self {
            view: self.view.transpose(),
        }
    }

    /// Returns `count` columns from `first` on.
    pub(super) fn columns(self, first: usize, count: usize) -> Self {
        Self {
            view: self.view.subcols(first, count),
        }
    }
}

/// Computes `out = a · b`, or `out += a · b` with [`Accum::Add`].
pub(crate) fn multiply(out: &mut [f32], accumulate: Accum, a: Matrix, b: Matrix) {
    let columns = b.view.ncols();
    multiply_into(out, columns, 0, accumulate, a, b);
}

/// Computes [`multiply`] for the columns from `first` on of a matrix with `columns` columns.
pub(super) fn multiply_into(out: &mut [f32], columns: usize, first: usize, accumulate: Accum, a: Matrix, b: Matrix) {
    let out = MatMut::from_row_major_slice_mut(out, a.view.nrows(), columns);
    product_into(out.subcols_mut(first, b.view.ncols()), accumulate, a.view, b.view);
}
