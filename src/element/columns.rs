//! Banded systems along y, one for each mode along x.

use std::ops::Range;

use deaflow_linalg::Mat;
use pulp::{Simd, WithSimd};

use crate::registers::dispatch_widest;

use super::lanes::{Value, WIDEST, Wide};
use super::layout::NodeLayout;

/// Number of modes in a block of [`Columns::respond`].
pub(super) const BLOCK: usize = WIDEST;
/// Share of the load below which a response counts as decayed.
const DECAYED: f32 = 1e-8;

/// LDLᵀ of K + λM along y for each mode, `[row][mode]`.
pub(super) struct Columns {
    nodes: usize,
    /// Rows of free nodes.
    free: Range<usize>,
    width: usize,
    /// 1/D.
    inverse: Vec<f32>,
    /// L below the diagonal, one array per distance from it.
    lower: Vec<Vec<f32>>,
}

impl Columns {
    /// Factorises the matrices of the rows of free nodes for these λ.
    pub(super) fn new(
        layout: NodeLayout,
        free: Range<usize>,
        (stiffness, mass): &(Mat<f64>, Mat<f64>),
        values: &[f64],
    ) -> Self {
        let ([_, nodes], width, band) = (layout.nodes(), values.len(), layout.degree());
        let mut inverse = vec![0.0; nodes * width];
        let mut lower = vec![vec![0.0; nodes * width]; band];
        for (mode, value) in values.iter().enumerate() {
            let entry = |i: usize, k: usize| stiffness[(i, k)] + value * mass[(i, k)];
            let (pivots, factors) = banded_factors(free.len(), band, &entry);
            for (i, pivot) in pivots.iter().enumerate() {
                inverse[(free.start + i) * width + mode] = (1.0 / pivot) as f32;
                for (distance, factor) in factors[i].iter().enumerate() {
                    lower[distance][(free.start + i) * width + mode] = *factor as f32;
                }
            }
        }
        Self {
            nodes,
            free,
            width,
            inverse,
            lower,
        }
    }

    /// Solves for all modes of each plane, in place.
    pub(super) fn solve(&self, modes: &mut [f32]) {
        dispatch_widest(ColumnSolve { columns: self, modes });
    }

    /// Writes the solutions for a unit load on a row in all modes to that row and the ones after it. Returns for each
    /// block of modes the row before which it has decayed; rows from there on are not written.
    pub(super) fn respond(&self, row: usize, plane: &mut [f32]) -> Vec<usize> {
        let starts = (0..self.width).step_by(BLOCK);
        starts.map(|first| self.respond_in_block(row, first, plane)).collect()
    }

    fn respond_in_block(&self, row: usize, first: usize, plane: &mut [f32]) -> usize {
        let band = self.lower.len();
        let at = |row: usize| row * self.width + first;
        let block = |values: &[f32], row: usize| -> [f32; BLOCK] { std::array::from_fn(|k| values[at(row) + k]) };
        let mut end = row;
        // How many rows in sequence have decayed.
        let mut decayed = 0;
        while end < self.free.end && decayed < band {
            let mut value = [if end == row { 1.0 } else { 0.0 }; BLOCK];
            for (distance, lower) in self.lower.iter().enumerate().take(end - row) {
                let (factors, source) = (block(lower, end), block(plane, end - distance - 1));
                (0..BLOCK).for_each(|k| value[k] -= factors[k] * source[k]);
            }
            decayed = if value.iter().all(|value| value.abs() < DECAYED) {
                decayed + 1
            } else {
                0
            };
            plane[at(end)..][..BLOCK].copy_from_slice(&value);
            end += 1;
        }
        for here in (row..end).rev() {
            let (mut value, inverse) = (block(plane, here), block(&self.inverse, here));
            (0..BLOCK).for_each(|k| value[k] *= inverse[k]);
            for (distance, lower) in self.lower.iter().enumerate().take(end - 1 - here) {
                let (factors, source) = (block(lower, here + distance + 1), block(plane, here + distance + 1));
                (0..BLOCK).for_each(|k| value[k] -= factors[k] * source[k]);
            }
            plane[at(here)..][..BLOCK].copy_from_slice(&value);
        }
        end
    }
}

/// Returns D and the rows of L, `[row][distance − 1]`, of a symmetric banded matrix.
fn banded_factors(n: usize, band: usize, entry: &dyn Fn(usize, usize) -> f64) -> (Vec<f64>, Vec<Vec<f64>>) {
    let (mut pivots, mut rows) = (vec![0.0; n], vec![vec![0.0; band]; n]);
    for i in 0..n {
        for distance in (1..=band.min(i)).rev() {
            let k = i - distance;
            let known = (1..=band - distance).filter(|d| *d <= k);
            let sum: f64 = known
                .map(|d| rows[i][distance + d - 1] * pivots[k - d] * rows[k][d - 1])
                .sum();
            rows[i][distance - 1] = (entry(i, k) - sum) / pivots[k];
        }
        let sum: f64 = (1..=band.min(i)).map(|d| rows[i][d - 1].powi(2) * pivots[i - d]).sum();
        pivots[i] = entry(i, i) - sum;
    }
    (pivots, rows)
}

/// Solves along y for all modes of each component, in place.
struct ColumnSolve<'a> {
    columns: &'a Columns,
    modes: &'a mut [f32],
}

impl WithSimd for ColumnSolve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Columns {
            nodes,
            free,
            width,
            inverse,
            lower,
        } = self.columns;
        for plane in self.modes.chunks_exact_mut(nodes * width) {
            for row in free.clone() {
                let (before, rest) = plane.split_at_mut(row * width);
                for (distance, lower) in lower.iter().enumerate().take(row) {
                    let source = &before[(row - distance - 1) * width..][..*width];
                    subtract_product::<S>(simd, &mut rest[..*width], &lower[row * width..], source);
                }
            }
            for row in free.clone().rev() {
                let (before, after) = plane.split_at_mut((row + 1) * width);
                let target = &mut before[row * width..];
                scale::<S>(simd, target, &inverse[row * width..]);
                for (distance, lower) in lower.iter().enumerate().take(nodes - 1 - row) {
                    let factors = &lower[(row + distance + 1) * width..];
                    subtract_product::<S>(simd, target, factors, &after[distance * width..][..*width]);
                }
            }
        }
    }
}

/// target ← target − factors · source.
#[inline(always)]
fn subtract_product<S: Simd>(simd: S, target: &mut [f32], factors: &[f32], source: &[f32]) {
    for at in (0..target.len()).step_by(S::F32_LANES) {
        let factor: Wide<S, f32> = Wide::load(simd, &factors[at..]);
        let sum = (-factor).madd(Wide::load(simd, &source[at..]), Wide::load(simd, &target[at..]));
        sum.store(&mut target[at..]);
    }
}

/// target ← factors · target.
#[inline(always)]
fn scale<S: Simd>(simd: S, target: &mut [f32], factors: &[f32]) {
    for at in (0..target.len()).step_by(S::F32_LANES) {
        let factor: Wide<S, f32> = Wide::load(simd, &factors[at..]);
        (factor * Wide::load(simd, &target[at..])).store(&mut target[at..]);
    }
}
