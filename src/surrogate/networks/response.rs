//! The exact linear response as a constant of a network: one matrix from cells to corners.
//!
//! The membrane and its frame are symmetric, so what is even (or odd) under a mirror stays so. The matrix falls into four
//! blocks for the parities of the pattern about the two middle lines, which is a quarter of the numbers and of the work.

use std::collections::BTreeMap;

use candle_core::{Device, Result, Tensor, bail};
use candle_nn::VarBuilder;
use faer::Accum;
use pulp::Arch;

use super::super::layers::{Matrix, multiply};
use super::super::onnx::{Graph, Value};
use super::super::parameters::constant;
use crate::fem::LinearResponse;
use crate::field::{CORNERS, Field};
use crate::pattern::{CELLS, Symmetry};

/// Cells along a side of a quadrant.
const SIDE: usize = CELLS / 2;
/// Cells of a quadrant, and corners of one: the middle lines belong to each, the frame to none.
const QUADRANT: usize = SIDE * SIDE;
/// Corners along a side without the frame.
const INNER: usize = CORNERS - 2;
/// Values of a displacement on a quadrant.
const VALUES: usize = 2 * QUADRANT;
const BLOCKS: [&str; 4] = ["response.even", "response.odd-x", "response.odd-y", "response.odd"];
const STRAIN: &str = "response.strain";

/// What is known of a scene before any training, as named tensors that go into the model and are not trained.
#[derive(Clone, Debug)]
pub struct Constants {
    pub(crate) tensors: BTreeMap<String, Tensor>,
}

/// A scene without such constants.
#[derive(Debug, thiserror::Error)]
pub enum ConstantsError {
    /// The linear systems cannot be solved.
    #[error("the linear response of the scene cannot be solved")]
    Unsolved,
    /// Nothing moves.
    #[error("nothing moves in this scene: there is nothing to learn")]
    Still,
    /// What the numerical library reported.
    #[error(transparent)]
    Failed(#[from] candle_core::Error),
}

impl Constants {
    /// The linear response of a scene to each cell.
    ///
    /// A displacement is counted in units of ε² L: L the side of the membrane and ε, the size of strain of the scene, the root mean
    /// square of the derivatives of the linear response to random patterns of single cells. What the linear response
    /// misses is of this size, and strain divided by ε is of size one, whatever the voltage.
    ///
    /// # Errors
    /// When the linear systems cannot be solved, or nothing moves.
    pub fn new(response: &LinearResponse, side_mm: f64) -> std::result::Result<Self, ConstantsError> {
        let below_diagonal: Vec<(usize, usize)> = (0..SIDE).flat_map(|y| (y..SIDE).map(move |x| (x, y))).collect();
        let solved = response.to_cells(&below_diagonal).ok_or(ConstantsError::Unsolved)?;
        let mut fields: BTreeMap<(usize, usize), Field> = BTreeMap::new();
        for ((x, y), field) in below_diagonal.into_iter().zip(solved) {
            fields.insert((y, x), field.transformed(diagonal()));
            fields.insert((x, y), field);
        }
        let strain = typical_strain(fields.values(), side_mm / CELLS as f64);
        if !(strain.is_finite() && strain > 0.0) {
            return Err(ConstantsError::Still);
        }
        let unit_mm = strain * strain * side_mm;
        let mut tensors = BTreeMap::new();
        for (block, name) in BLOCKS.into_iter().enumerate() {
            let mut values = vec![0.0f32; QUADRANT * VALUES];
            for ((x, y), field) in &fields {
                let row = &mut values[(y * SIDE + x) * VALUES..][..VALUES];
                write_row(field, block, unit_mm, row);
            }
            let tensor = Tensor::from_vec(values, (QUADRANT, VALUES), &Device::Cpu)?;
            tensors.insert(name.to_owned(), tensor);
        }
        let strain = Tensor::new(&[strain as f32, side_mm as f32], &Device::Cpu)?;
        tensors.insert(STRAIN.to_owned(), strain);
        Ok(Self { tensors })
    }
}

/// The mirror about the diagonal x = y.
fn diagonal() -> Symmetry {
    let swaps = |g: &Symmetry| g.matrix() == [[0, 1], [1, 0]];
    Symmetry::ALL.into_iter().find(swaps).unwrap_or(Symmetry::IDENTITY)
}

/// Sign of the mirror image of parity block `block` (bit 0: odd along x, bit 1: odd along y) under mirrors (bits likewise).
fn sign(block: usize, mirrors: usize) -> f64 {
    if (block & mirrors).count_ones().is_multiple_of(2) {
        1.0
    } else {
        -1.0
    }
}

/// Sign that a component of the displacement takes under mirrors beside the parity of the pattern.
fn turns(component: usize, mirrors: usize) -> f64 {
    if mirrors >> component & 1 == 0 { 1.0 } else { -1.0 }
}

/// A quarter of the signed sum of the mirror images of a field, on the corners of the first quadrant: what the folded pattern
/// is multiplied by.
fn write_row(field: &Field, block: usize, unit_mm: f64, row: &mut [f32]) {
    for (at, value) in row.iter_mut().enumerate() {
        let (component, y, x) = (at / QUADRANT, at % QUADRANT / SIDE + 1, at % SIDE + 1);
        let image = |mirrors: usize| {
            let [x, y] = [(x, 1), (y, 2)].map(|(i, bit)| if mirrors & bit == 0 { i } else { CORNERS - 1 - i });
            sign(block, mirrors) * turns(component, mirrors) * field.at_corner(x, y)[component]
        };
        *value = ((0..4).map(image).sum::<f64>() / (4.0 * unit_mm)) as f32;
    }
}

/// Root mean square over cells and derivatives of the strain that patterns of independent random cells cause.
fn typical_strain<'a>(quadrant: impl Iterator<Item = &'a Field>, cell_mm: f64) -> f64 {
    // The variance of a cell is a quarter, and each cell of the quadrant stands for four.
    let mut sum = 0.0;
    for field in quadrant {
        for y in 0..CELLS {
            for x in 0..CELLS {
                let [a, b, c, d] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| field.at_corner(x + i, y + j));
                for k in 0..2 {
                    let (across, up) = (b[k] + d[k] - a[k] - c[k], c[k] + d[k] - a[k] - b[k]);
                    sum += (across * across + up * up) / (4.0 * cell_mm * cell_mm);
                }
            }
        }
    }
    (sum / (4 * CELLS * CELLS) as f64).sqrt()
}

/// The response as a layer.
pub(crate) struct Response {
    /// The transpose of each block, (values, cells): with many patterns as its columns the product is a third faster.
    blocks: Vec<Vec<f32>>,
    strain: f64,
    side_mm: f64,
}

impl Response {
    /// From the constants of a model.
    pub(crate) fn new(weights: &VarBuilder<'_>) -> Result<Self> {
        let mut blocks = Vec::with_capacity(4);
        for name in BLOCKS {
            let block = constant(weights, name, &[QUADRANT, VALUES])?;
            blocks.push(block.t()?.flatten_all()?.to_vec1()?);
        }
        let strain: Vec<f32> = constant(weights, STRAIN, &[2])?.to_vec1()?;
        let [strain, side_mm] = strain[..] else {
            bail!("{STRAIN} has two values");
        };
        if !(strain > 0.0 && side_mm > 0.0) {
            bail!("{STRAIN} is {strain} and {side_mm}: both must be above 0");
        }
        Ok(Self {
            blocks,
            strain: strain.into(),
            side_mm: side_mm.into(),
        })
    }

    /// ε.
    pub(crate) fn strain(&self) -> f64 {
        self.strain
    }

    /// ε² L in mm: the unit of displacement.
    pub(crate) fn unit_mm(&self) -> f64 {
        self.strain * self.strain * self.side_mm
    }

    /// The linear response (n, 2, 49, 49) to patterns (n, 50, 50), ±½ per cell; it has no gradient.
    pub(crate) fn forward(&self, patterns: &Tensor) -> Result<Tensor> {
        let n = patterns.dim(0)?;
        let cells: Vec<f32> = patterns.flatten_all()?.to_vec1()?;
        let displacements = self.evaluate(&cells);
        Tensor::from_vec(displacements, (n, 2, INNER, INNER), &Device::Cpu)
    }

    /// Draws the same as operations of ONNX: folding and unfolding are products with matrices of 0, 1 and −1.
    pub(crate) fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let (side, quadrant) = (SIDE as i64, QUADRANT as i64);
        let mut sum: Option<Value> = None;
        for (block, weights) in self.blocks.iter().enumerate() {
            let rows = graph.tensor(&folding(sign(block, 2) as f32)?)?;
            let columns = graph.tensor(&folding(sign(block, 1) as f32)?.t()?.contiguous()?)?;
            let folded = graph.matmul(&rows, patterns);
            let folded = graph.matmul(&folded, &columns);
            let folded = graph.reshape(&folded, &[0, quadrant]);
            let weights = Tensor::from_slice(weights, (VALUES, QUADRANT), &Device::Cpu)?;
            let weights = graph.tensor(&weights.t()?.contiguous()?)?;
            let quadrants = graph.matmul(&folded, &weights);
            let quadrants = graph.reshape(&quadrants, &[0, 2, side, side]);
            let rows = graph.tensor(&unfolding(block, 2)?)?;
            let columns = graph.tensor(&unfolding(block, 1)?.transpose(1, 2)?.contiguous()?)?;
            let part = graph.matmul(&rows, &quadrants);
            let part = graph.matmul(&part, &columns);
            sum = Some(match sum {
                Some(sum) => graph.add(&sum, &part),
                None => part,
            });
        }
        match sum {
            Some(sum) => Ok(sum),
            None => bail!("the response has no blocks"),
        }
    }

    /// The same on plain numbers.
    pub(crate) fn evaluate(&self, cells: &[f32]) -> Vec<f32> {
        // A matrix times a single vector is summed in another order: a pattern alone stands beside an empty column.
        let n = (cells.len() / (CELLS * CELLS)).max(2);
        let mut folded = vec![0.0f32; n * QUADRANT];
        let mut quadrants = vec![0.0f32; n * VALUES];
        let mut columns = vec![0.0f32; n * VALUES];
        let mut displacements = vec![0.0f32; cells.len() / (CELLS * CELLS) * 2 * INNER * INNER];
        for (block, weights) in self.blocks.iter().enumerate() {
            let images = cells.chunks_exact(CELLS * CELLS);
            for (cells, folded) in images.zip(folded.chunks_exact_mut(QUADRANT)) {
                Arch::new().dispatch(
                    #[inline(always)]
                    || fold(cells, block, folded),
                );
            }
            let patterns = &mut columns[..n * QUADRANT];
            transpose(&folded, QUADRANT, patterns);
            let patterns = Matrix::new(patterns, n);
            multiply(&mut quadrants, Accum::Replace, Matrix::new(weights, QUADRANT), patterns);
            transpose(&quadrants, n, &mut columns);
            let quadrants = columns.chunks_exact(VALUES);
            for (quadrant, displacement) in quadrants.zip(displacements.chunks_exact_mut(2 * INNER * INNER)) {
                Arch::new().dispatch(
                    #[inline(always)]
                    || unfold(quadrant, block, displacement),
                );
            }
        }
        displacements
    }
}

/// The matrix (25, 50) that adds the mirror image of a line of cells, times a sign, to its first half.
fn folding(sign: f32) -> Result<Tensor> {
    let mut values = vec![0.0f32; SIDE * CELLS];
    for (at, row) in values.chunks_exact_mut(CELLS).enumerate() {
        row[at] = 1.0;
        row[CELLS - 1 - at] = sign;
    }
    Tensor::from_vec(values, (SIDE, CELLS), &Device::Cpu)
}

/// For both components the matrix (49, 25) that continues a line of the first half's corners by its mirror image, with the
/// sign that it has in a block under the mirror `bit`: (2, 49, 25).
fn unfolding(block: usize, bit: usize) -> Result<Tensor> {
    let mut values = vec![0.0f32; 2 * INNER * SIDE];
    for (component, matrix) in values.chunks_exact_mut(INNER * SIDE).enumerate() {
        for at in 0..SIDE {
            // The middle line is its own image.
            matrix[(INNER - 1 - at) * SIDE + at] = (sign(block, bit) * turns(component, bit)) as f32;
            matrix[at * SIDE + at] = 1.0;
        }
    }
    Tensor::from_vec(values, (2, INNER, SIDE), &Device::Cpu)
}

/// The transpose of a matrix of rows of `columns` numbers, tile by tile so that both sides stay in the cache.
fn transpose(matrix: &[f32], columns: usize, transposed: &mut [f32]) {
    const TILE: usize = 16;
    let rows = matrix.len() / columns;
    for first in (0..columns).step_by(TILE) {
        for (row, line) in matrix.chunks_exact(columns).enumerate() {
            let tile = &line[first..columns.min(first + TILE)];
            for (column, value) in (first..).zip(tile) {
                transposed[column * rows + row] = *value;
            }
        }
    }
}

/// The signed sum of the four mirror images of a pattern on the first quadrant.
#[inline(always)]
fn fold(cells: &[f32], block: usize, folded: &mut [f32]) {
    let [x, y] = [1, 2].map(|bit| sign(block, bit) as f32);
    for (row, line) in folded.chunks_exact_mut(SIDE).enumerate() {
        let (low, high) = (
            &cells[row * CELLS..][..CELLS],
            &cells[(CELLS - 1 - row) * CELLS..][..CELLS],
        );
        for (column, value) in line.iter_mut().enumerate() {
            let mirrored = CELLS - 1 - column;
            *value = (low[column] + x * low[mirrored]) + y * (high[column] + x * high[mirrored]);
        }
    }
}

/// Adds the values on the first quadrant, with the signs of their mirror images, to all corners.
#[inline(always)]
fn unfold(quadrant: &[f32], block: usize, displacement: &mut [f32]) {
    for component in 0..2 {
        let [x, y] = [1, 2].map(|bit| (sign(block, bit) * turns(component, bit)) as f32);
        let plane = &mut displacement[component * INNER * INNER..][..INNER * INNER];
        for (row, line) in quadrant[component * QUADRANT..][..QUADRANT]
            .chunks_exact(SIDE)
            .enumerate()
        {
            let mut add = |row: usize, factor: f32| {
                let to = &mut plane[row * INNER..][..INNER];
                for (column, value) in line.iter().enumerate() {
                    to[column] += factor * value;
                    if column < SIDE - 1 {
                        to[INNER - 1 - column] += factor * x * value;
                    }
                }
            };
            add(row, 1.0);
            if row < SIDE - 1 {
                add(INNER - 1 - row, y);
            }
        }
    }
}
