//! Mirror symmetry of the linear response. Even patterns have even responses and odd patterns odd ones, so the matrix
//! from cells to corners splits into one block per parity. With two mirror axes this takes a quarter of the memory and
//! work.
//!
//! Patterns are folded to the fundamental part of the device (a half or a quarter), whose mirror images cover the
//! device.

use candle_core::{Device, Result, Tensor};

use crate::corners::inner_sides;
use deaflow_pattern::{Raster, Symmetries, Symmetry};

/// The mirror symmetries of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fold {
    raster: Raster,
    /// Whether x → −x and y → −y are symmetries.
    folded: [bool; 2],
}

/// Returns the sign of a mirror image in the parity block `block` (bit 0: odd along x, bit 1: odd along y). `mirrors`
/// has the same bits.
pub(super) fn parity_sign(block: usize, mirrors: usize) -> f64 {
    if (block & mirrors).count_ones().is_multiple_of(2) {
        1.0
    } else {
        -1.0
    }
}

/// Returns the sign of a displacement component under mirrors, in addition to the parity of the pattern.
pub(super) fn component_sign(component: usize, mirrors: usize) -> f64 {
    if mirrors >> component & 1 == 0 { 1.0 } else { -1.0 }
}

impl Fold {
    /// Finds the mirrors among the symmetries of a device.
    pub(super) fn new(raster: Raster, symmetries: Symmetries) -> Self {
        let has = |matrix: [[i32; 2]; 2]| symmetries.iter().any(|g: Symmetry| g.matrix() == matrix);
        Self {
            raster,
            folded: [has([[-1, 0], [0, 1]]), has([[1, 0], [0, -1]])],
        }
    }

    /// Finds the mirrors from the parity blocks of a response.
    pub(super) fn of_blocks(raster: Raster, has: impl Fn(usize) -> bool) -> Self {
        Self {
            raster,
            folded: [has(1), has(2)],
        }
    }

    /// Returns the cells of the device.
    pub(super) fn raster(self) -> Raster {
        self.raster
    }

    /// Returns whether an axis is folded.
    pub(super) fn is_folded(self, axis: usize) -> bool {
        self.folded[axis]
    }

    /// Returns columns and rows of cells of the fundamental part. It includes a middle line of cells.
    pub(super) fn cells(self) -> [usize; 2] {
        self.halves(self.raster.sides())
    }

    /// Returns columns and rows of inner corners of the fundamental part. It includes a middle line of corners.
    pub(super) fn corners(self) -> [usize; 2] {
        self.halves(self.inner())
    }

    /// Returns columns and rows of inner corners of the device.
    pub(super) fn inner(self) -> [usize; 2] {
        inner_sides(self.raster)
    }

    fn halves(self, sides: [usize; 2]) -> [usize; 2] {
        [0, 1].map(|axis| sides[axis].div_ceil(if self.folded[axis] { 2 } else { 1 }))
    }

    /// Returns the number of cells of the fundamental part.
    pub(super) fn area(self) -> usize {
        self.cells().into_iter().product()
    }

    /// Returns the number of displacement values at the inner corners of the fundamental part.
    pub(super) fn values(self) -> usize {
        2 * self.corners().into_iter().product::<usize>()
    }

    /// Returns the parities, or equally the combinations of mirrors, as bits. The first is 0.
    pub(super) fn parities(self) -> impl Iterator<Item = usize> {
        let bits = usize::from(self.folded[0]) | usize::from(self.folded[1]) << 1;
        (0..4).filter(move |parity| parity & !bits == 0)
    }

    /// Folds a pattern: adds its mirror images with their signs on the fundamental part.
    #[inline(always)]
    pub(super) fn fold(self, cells: &[f32], block: usize, folded: &mut [f32]) {
        let [x, y] = [1, 2].map(|bit| parity_sign(block, bit) as f32);
        let ([columns, rows], [width, _]) = (self.raster.sides(), self.cells());
        for (row, line) in folded.chunks_exact_mut(width).enumerate() {
            let (low, high) = (
                &cells[row * columns..][..columns],
                &cells[(rows - 1 - row) * columns..][..columns],
            );
            // A middle line is its own image and counts once.
            let is_single = !self.folded[1] || 2 * row + 1 == rows;
            let pairs = if self.folded[0] { columns / 2 } else { 0 };
            match is_single {
                true => {
                    for column in 0..pairs {
                        line[column] = low[column] + x * low[columns - 1 - column];
                    }
                    line[pairs..].copy_from_slice(&low[pairs..width]);
                }
                false => {
                    for (column, value) in line[..pairs].iter_mut().enumerate() {
                        let mirrored = columns - 1 - column;
                        *value = (low[column] + x * low[mirrored]) + y * (high[column] + x * high[mirrored]);
                    }
                    for column in pairs..width {
                        line[column] = low[column] + y * high[column];
                    }
                }
            }
        }
    }

    /// Unfolds values at the corners of the fundamental part: adds them and their signed mirror images to all inner
    /// corners.
    #[inline(always)]
    pub(super) fn unfold(self, part: &[f32], block: usize, displacement: &mut [f32]) {
        let ([width, height], [columns, rows]) = (self.corners(), self.inner());
        let pairs = if self.folded[0] { columns / 2 } else { 0 };
        for component in 0..2 {
            let [x, y] = [1, 2].map(|bit| (parity_sign(block, bit) * component_sign(component, bit)) as f32);
            let plane = &mut displacement[component * columns * rows..][..columns * rows];
            let part = &part[component * width * height..][..width * height];
            for (row, line) in part.chunks_exact(width).enumerate() {
                let mut add = |row: usize, factor: f32| {
                    let to = &mut plane[row * columns..][..columns];
                    for (column, value) in line.iter().enumerate() {
                        to[column] += factor * value;
                        if column < pairs {
                            to[columns - 1 - column] += factor * x * value;
                        }
                    }
                };
                add(row, 1.0);
                if self.folded[1] && row < rows / 2 {
                    add(rows - 1 - row, y);
                }
            }
        }
    }

    /// Returns the matrix (half, all) that folds a line of cells along an axis, with the sign of the parity block
    /// `block`.
    pub(super) fn folding(self, axis: usize, block: usize) -> Result<Tensor> {
        let (half, all) = (self.cells()[axis], self.raster.sides()[axis]);
        let mut values = vec![0.0f32; half * all];
        for (at, row) in values.chunks_exact_mut(all).enumerate() {
            row[all - 1 - at] = parity_sign(block, 1 << axis) as f32;
            row[at] = 1.0;
        }
        Tensor::from_vec(values, (half, all), &Device::Cpu)
    }

    /// Returns the matrices (all, half) that unfold a line of corners along an axis, for both components, with the
    /// sign of the parity block `block`: (2, all, half).
    pub(super) fn unfolding(self, axis: usize, block: usize) -> Result<Tensor> {
        let (half, all, bit) = (self.corners()[axis], self.inner()[axis], 1 << axis);
        let mut values = vec![0.0f32; 2 * all * half];
        for (component, matrix) in values.chunks_exact_mut(all * half).enumerate() {
            for at in 0..half {
                // A middle line is its own image.
                matrix[(all - 1 - at) * half + at] = (parity_sign(block, bit) * component_sign(component, bit)) as f32;
                matrix[at * half + at] = 1.0;
            }
        }
        Tensor::from_vec(values, (2, all, half), &Device::Cpu)
    }
}
