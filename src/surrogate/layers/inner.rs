//! Inner products of a few long rows with a few others: the gradients of a local law, which sum over all cells.
//!
//! As matrix products they are much deeper than wide, for which a general kernel uses a quarter of the registers. This
//! kernel accumulates eight vectors at a time.

use deaflow_fem::registers::dispatch;
use pulp::{Simd, WithSimd};

/// Computes `out[i][j] += Σ a[i][k] · b[j][k]` for rows of `length` values, always in the same order.
pub(super) fn add_inner_products(out: &mut [f32], a: &[f32], b: &[f32], length: usize) {
    dispatch(InnerProducts { out, a, b, length });
}

struct InnerProducts<'a> {
    out: &'a mut [f32],
    a: &'a [f32],
    b: &'a [f32],
    length: usize,
}

impl WithSimd for InnerProducts<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { out, a, b, length } = self;
        let columns = b.len() / length;
        let (mut out, mut a) = (out, a);
        while !a.is_empty() {
            let rows = match a.len() / length {
                4.. => 4,
                2 | 3 => 2,
                _ => 1,
            };
            let (sums, others) = out.split_at_mut(rows * columns);
            let (these, rest) = a.split_at(rows * length);
            match rows {
                4 => of_rows::<S, 4>(simd, sums, these, b, length),
                2 => of_rows::<S, 2>(simd, sums, these, b, length),
                _ => of_rows::<S, 1>(simd, sums, these, b, length),
            }
            (out, a) = (others, rest);
        }
    }
}

/// Adds the inner products of M rows of `a` with all rows of `b`.
#[inline(always)]
fn of_rows<S: Simd, const M: usize>(simd: S, out: &mut [f32], a: &[f32], b: &[f32], length: usize) {
    let columns = b.len() / length;
    let mut rows = [a; M];
    for (i, row) in rows.iter_mut().enumerate() {
        *row = &a[i * length..(i + 1) * length];
    }
    for (pair, b) in b.chunks(2 * length).enumerate() {
        let at = 2 * pair;
        match b.len() == 2 * length {
            true => {
                let (first, second) = b.split_at(length);
                add(out, [columns, at], of_block(simd, rows, [first, second]));
            }
            false => add(out, [columns, at], of_block(simd, rows, [b])),
        }
    }
}

/// Adds a block to the columns from `at` on.
#[inline(always)]
fn add<const M: usize, const N: usize>(out: &mut [f32], [columns, at]: [usize; 2], block: [[f32; N]; M]) {
    for (out, sums) in out.chunks_exact_mut(columns).zip(block) {
        for (out, sum) in out[at..at + N].iter_mut().zip(sums) {
            *out += sum;
        }
    }
}

/// Computes a block of inner products. It uses plain loops, because closures are not compiled with the vector
/// instructions.
#[inline(always)]
#[allow(clippy::needless_range_loop)]
fn of_block<S: Simd, const M: usize, const N: usize>(simd: S, a: [&[f32]; M], b: [&[f32]; N]) -> [[f32; N]; M] {
    let zero = simd.splat_f32s(0.0);
    let (mut rows, mut row_ends): ([&[S::f32s]; M], [&[f32]; M]) = ([&[]; M], [&[]; M]);
    let (mut columns, mut column_ends): ([&[S::f32s]; N], [&[f32]; N]) = ([&[]; N], [&[]; N]);
    for i in 0..M {
        (rows[i], row_ends[i]) = S::as_simd_f32s(a[i]);
    }
    for j in 0..N {
        (columns[j], column_ends[j]) = S::as_simd_f32s(b[j]);
    }
    let count = rows[0].len();
    for i in 0..M {
        rows[i] = &rows[i][..count];
    }
    for j in 0..N {
        columns[j] = &columns[j][..count];
    }
    let mut sums = [[zero; N]; M];
    for k in 0..count {
        let mut y = [zero; N];
        for j in 0..N {
            y[j] = columns[j][k];
        }
        for i in 0..M {
            let x = rows[i][k];
            for j in 0..N {
                sums[i][j] = simd.mul_add_f32s(x, y[j], sums[i][j]);
            }
        }
    }
    let mut block = [[0.0; N]; M];
    for i in 0..M {
        for j in 0..N {
            let mut sum = simd.reduce_sum_f32s(sums[i][j]);
            for (x, y) in row_ends[i].iter().zip(column_ends[j]) {
                sum = x.mul_add(*y, sum);
            }
            block[i][j] = sum;
        }
    }
    block
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_equal_plain_sums() {
        let numbers = |count: usize, salt: usize| -> Vec<f32> {
            let number = |i: usize| ((i * 31 + salt) * 17 % 11) as f32 - 5.0;
            (0..count).map(number).collect()
        };
        // All remainders of rows, columns and lengths.
        for rows in 1..8 {
            for columns in 1..4 {
                for length in [1, 7, 8, 9, 2500, 2501] {
                    let (a, b) = (numbers(rows * length, 1), numbers(columns * length, 2));
                    let mut out = vec![0.5; rows * columns];
                    add_inner_products(&mut out, &a, &b, length);
                    for (at, found) in out.into_iter().enumerate() {
                        let row = &a[at / columns * length..][..length];
                        let column = &b[at % columns * length..][..length];
                        // Sums of whole numbers are exact.
                        let expected: f32 = row.iter().zip(column).map(|(a, b)| a * b).sum();
                        assert_eq!(found, 0.5 + expected, "{rows} {columns} {length} {at}");
                    }
                }
            }
        }
    }
}
