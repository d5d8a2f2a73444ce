//! Products of small dense matrices in single precision, for the fast diagonalisation.
//!
//! The matrices fit in the L2 cache, so nothing is packed: a tile of the result stays in registers during the loop over
//! a row of the right factor and a column of the left one.

use pulp::{Simd, WithSimd};

use crate::registers::dispatch_widest;

/// A matrix inside a larger row-major array: row i starts at `offset + i · stride`.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// Index of the first row.
    pub offset: usize,
    /// Distance between rows.
    pub stride: usize,
}

/// The product target = left · right, with `inner` columns in the left matrix. Rows of `right` have `width` numbers, a
/// multiple of the widest register.
pub struct Product<'a> {
    /// The left factor.
    pub left: &'a [f32],
    /// Layout of the left factor.
    pub left_layout: Layout,
    /// The right factor, row by row.
    pub right: &'a [f32],
    /// Columns of the right factor and of the result.
    pub width: usize,
    /// Columns of the left factor.
    pub inner: usize,
    /// Rows of the left factor and of the result.
    pub rows: usize,
    /// The result.
    pub target: &'a mut [f32],
    /// Layout of the result.
    pub target_layout: Layout,
}

impl Product<'_> {
    /// Computes the product.
    pub fn run(self) {
        dispatch_widest(self);
    }
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let lanes = S::F32_LANES;
        for column in (0..self.width).step_by(2 * lanes) {
            if column + 2 * lanes <= self.width {
                self.panel::<S, 2>(simd, column);
            } else {
                self.panel::<S, 1>(simd, column);
            }
        }
    }
}

impl Product<'_> {
    /// Computes all rows of the columns of C registers.
    #[inline(always)]
    fn panel<S: Simd, const C: usize>(&mut self, simd: S, column: usize) {
        let mut row = 0;
        if S::REGISTER_COUNT >= 32 {
            row = self.tiles::<S, 8, C>(simd, row, column);
        }
        row = self.tiles::<S, 4, C>(simd, row, column);
        self.tiles::<S, 1, C>(simd, row, column);
    }

    /// Computes complete tiles of R rows; returns the first remaining row.
    #[inline(always)]
    fn tiles<S: Simd, const R: usize, const C: usize>(&mut self, simd: S, mut row: usize, column: usize) -> usize {
        while row + R <= self.rows {
            self.tile::<S, R, C>(simd, row, column);
            row += R;
        }
        row
    }

    #[inline(always)]
    fn tile<S: Simd, const R: usize, const C: usize>(&mut self, simd: S, row: usize, column: usize) {
        let lanes = S::F32_LANES;
        let lines: [&[f32]; R] = std::array::from_fn(|r| {
            let start = self.left_layout.offset + (row + r) * self.left_layout.stride;
            &self.left[start..start + self.inner]
        });
        let mut sums = [[simd.splat_f32s(0.0); C]; R];
        for (k, right) in self.right.chunks_exact(self.width).take(self.inner).enumerate() {
            let right = S::as_simd_f32s(&right[column..column + C * lanes]).0;
            for (sums, line) in sums.iter_mut().zip(lines) {
                let factor = simd.splat_f32s(line[k]);
                for (sum, right) in sums.iter_mut().zip(right) {
                    *sum = simd.mul_add_e_f32s(factor, *right, *sum);
                }
            }
        }
        for (r, sums) in sums.iter().enumerate() {
            let start = self.target_layout.offset + (row + r) * self.target_layout.stride + column;
            let target = S::as_mut_simd_f32s(&mut self.target[start..start + C * lanes]).0;
            target.copy_from_slice(sums);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_exact_for_every_shape() {
        for (rows, inner, width) in [(1, 1, 16), (7, 3, 16), (13, 25, 32), (21, 10, 48), (102, 25, 32)] {
            let left: Vec<f32> = (0..5 + rows * 40).map(|i| ((i * 7) % 11) as f32 - 5.0).collect();
            let right: Vec<f32> = (0..inner * width).map(|i| ((i * 5) % 13) as f32 - 6.0).collect();
            let mut target = vec![f32::NAN; 3 + rows * 50];
            let (left_layout, target_layout) = (Layout { offset: 5, stride: 40 }, Layout { offset: 3, stride: 50 });
            Product {
                left: &left,
                left_layout,
                right: &right,
                width,
                inner,
                rows,
                target: &mut target,
                target_layout,
            }
            .run();
            for (i, k) in (0..rows * width).map(|at| (at / width, at % width)) {
                let exact: f32 = (0..inner).map(|m| left[5 + i * 40 + m] * right[m * width + k]).sum();
                assert_eq!(target[3 + i * 50 + k], exact);
            }
        }
    }
}
