//! What mirrors of a device make of its linear response: what is even (or odd) under a mirror stays so, and the matrix from cells to
//! corners falls into blocks for the parities of the pattern, which is a quarter of the numbers and of the work where both middle lines are mirrors.

use candle_core::{Device, Result, Tensor};

use deaflow_pattern::{Raster, Symmetries, Symmetry};

/// Which mirrors are symmetries of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fold {
    raster: Raster,
    /// Along x, and along y.
    folded: [bool; 2],
}

/// Sign of the mirror image of parity block `block` (bit 0: odd along x, bit 1: odd along y) under mirrors (bits likewise).
pub(super) fn sign(block: usize, mirrors: usize) -> f64 {
    if (block & mirrors).count_ones().is_multiple_of(2) {
        1.0
    } else {
        -1.0
    }
}

/// Sign that a component of the displacement takes under mirrors beside the parity of the pattern.
pub(super) fn turns(component: usize, mirrors: usize) -> f64 {
    if mirrors >> component & 1 == 0 { 1.0 } else { -1.0 }
}

impl Fold {
    /// By the symmetries of a device.
    pub(super) fn new(raster: Raster, symmetries: Symmetries) -> Self {
        let has = |matrix: [[i32; 2]; 2]| symmetries.iter().any(|g: Symmetry| g.matrix() == matrix);
        Self {
            raster,
            folded: [has([[-1, 0], [0, 1]]), has([[1, 0], [0, -1]])],
        }
    }

    /// By the parity blocks that a response has.
    pub(super) fn of_blocks(raster: Raster, has: impl Fn(usize) -> bool) -> Self {
        Self {
            raster,
            folded: [has(1), has(2)],
        }
    }

    /// The cells of all of it.
    pub(super) fn raster(self) -> Raster {
        self.raster
    }

    /// Whether an axis is folded.
    pub(super) fn is_folded(self, axis: usize) -> bool {
        self.folded[axis]
    }

    /// Columns and rows of cells of the part that stands for all: a middle line of cells belongs to it.
    pub(super) fn cells(self) -> [usize; 2] {
        self.halves(self.raster.sides())
    }

    /// Columns and rows of corners of that part without the edges: a middle line belongs to it.
    pub(super) fn corners(self) -> [usize; 2] {
        self.halves(self.inner())
    }

    /// Columns and rows of all corners without the edges.
    pub(super) fn inner(self) -> [usize; 2] {
        self.raster.sides().map(|side| side - 1)
    }

    fn halves(self, sides: [usize; 2]) -> [usize; 2] {
        [0, 1].map(|axis| {
            if self.folded[axis] {
                sides[axis].div_ceil(2)
            } else {
                sides[axis]
            }
        })
    }

    /// Cells of that part.
    pub(super) fn area(self) -> usize {
        self.cells().into_iter().product()
    }

    /// Values of a displacement on the corners of that part.
    pub(super) fn values(self) -> usize {
        2 * self.corners().into_iter().product::<usize>()
    }

    /// The mirrors, none of them first, as sets of bits; the parities are as many.
    pub(super) fn parities(self) -> impl Iterator<Item = usize> {
        let bits = usize::from(self.folded[0]) | usize::from(self.folded[1]) << 1;
        (0..4).filter(move |parity| parity & !bits == 0)
    }

    /// The signed sum of the mirror images of a pattern on the part that stands for all.
    #[inline(always)]
    pub(super) fn fold(self, cells: &[f32], block: usize, folded: &mut [f32]) {
        let [x, y] = [1, 2].map(|bit| sign(block, bit) as f32);
        let ([columns, rows], [width, _]) = (self.raster.sides(), self.cells());
        for (row, line) in folded.chunks_exact_mut(width).enumerate() {
            let (low, high) = (
                &cells[row * columns..][..columns],
                &cells[(rows - 1 - row) * columns..][..columns],
            );
            // A middle line is its own image, and counts once.
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

    /// Adds the values on the corners of that part, with the signs of their mirror images, to all corners.
    #[inline(always)]
    pub(super) fn unfold(self, part: &[f32], block: usize, displacement: &mut [f32]) {
        let ([width, height], [columns, rows]) = (self.corners(), self.inner());
        let pairs = if self.folded[0] { columns / 2 } else { 0 };
        for component in 0..2 {
            let [x, y] = [1, 2].map(|bit| (sign(block, bit) * turns(component, bit)) as f32);
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

    /// The matrix (half, all) that adds the mirror image of a line of cells along an axis, times a sign, to its first half.
    pub(super) fn folding(self, axis: usize, sign: f32) -> Result<Tensor> {
        let (half, all) = (self.cells()[axis], self.raster.sides()[axis]);
        let mut values = vec![0.0f32; half * all];
        for (at, row) in values.chunks_exact_mut(all).enumerate() {
            row[all - 1 - at] = sign;
            row[at] = 1.0;
        }
        Tensor::from_vec(values, (half, all), &Device::Cpu)
    }

    /// For both components the matrix (all, half) that continues a line of the first half's corners along an axis by its mirror image, with
    /// the sign that it has in a block: (2, all, half).
    pub(super) fn unfolding(self, axis: usize, block: usize) -> Result<Tensor> {
        let (half, all, bit) = (self.corners()[axis], self.inner()[axis], 1 << axis);
        let mut values = vec![0.0f32; 2 * all * half];
        for (component, matrix) in values.chunks_exact_mut(all * half).enumerate() {
            for at in 0..half {
                // A middle line is its own image.
                matrix[(all - 1 - at) * half + at] = (sign(block, bit) * turns(component, bit)) as f32;
                matrix[at * half + at] = 1.0;
            }
        }
        Tensor::from_vec(values, (2, all, half), &Device::Cpu)
    }
}
