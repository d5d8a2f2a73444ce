//! Row-major matrix products on one thread.
//!
//! candle hands its products to a library that splits them over as many threads as the machine has. The parallelism of this room lies
//! across patterns instead, so every product is computed by one thread, always in the same order: results are the same bits whatever the
//! number of threads, and a product is never too small to split well.

use deaflow_linalg::{Accum, MatMut, MatRef, product_into};

/// A row-major matrix, or the transpose of one.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a> {
    view: MatRef<'a, f32>,
}

impl<'a> Matrix<'a> {
    /// The matrix of `columns` values a row.
    pub(crate) fn new(values: &'a [f32], columns: usize) -> Self {
        let view = MatRef::from_row_major_slice(values, values.len() / columns, columns);
        Self { view }
    }

    /// The transpose.
    pub(crate) fn transposed(self) -> Self {
        Self {
            view: self.view.transpose(),
        }
    }

    /// `count` columns from `first` on.
    pub(super) fn columns(self, first: usize, count: usize) -> Self {
        Self {
            view: self.view.subcols(first, count),
        }
    }
}

/// `out = a · b`, or `out += a · b` with [`Accum::Add`].
pub(crate) fn multiply(out: &mut [f32], accumulate: Accum, a: Matrix, b: Matrix) {
    let columns = b.view.ncols();
    multiply_into(out, columns, 0, accumulate, a, b);
}

/// The same into the columns from `first` on of a matrix of `columns` columns.
pub(super) fn multiply_into(out: &mut [f32], columns: usize, first: usize, accumulate: Accum, a: Matrix, b: Matrix) {
    let out = MatMut::from_row_major_slice_mut(out, a.view.nrows(), columns);
    product_into(out.subcols_mut(first, b.view.ncols()), accumulate, a.view, b.view);
}
