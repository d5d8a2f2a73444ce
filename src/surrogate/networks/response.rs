//! The exact linear response as constant weights: a matrix from cells to corners in parity blocks, and the
//! displacement by loads on bodies.

use candle_core::{Device, Result, Tensor, bail};
use candle_nn::VarBuilder;
use deaflow_fem::registers::dispatch;
use deaflow_linalg::Accum;

use super::fold::Fold;
use super::names;
use crate::corners::inner_corners;
use crate::layers::{Matrix, multiply};
use crate::onnx::{Graph, Value};
use crate::parameters::constant;
use deaflow_pattern::Raster;

/// The linear response as a layer.
pub(crate) struct Response {
    fold: Fold,
    /// The transpose of each block, (values, cells), with its parity. The product with patterns as columns is a third
    /// faster.
    blocks: Vec<(usize, Vec<f32>)>,
    /// Displacement by loads on bodies, (2, rows − 1, columns − 1), if there are any.
    loaded: Option<Vec<f32>>,
    strain: f64,
    side_mm: f64,
}

impl Response {
    /// Reads the constants of a model.
    pub(crate) fn new(weights: &VarBuilder<'_>, raster: Raster) -> Result<Self> {
        let fold = Fold::of_blocks(raster, |block| weights.contains_tensor(names::BLOCKS[block]));
        let (area, values) = (fold.area(), fold.values());
        let mut blocks = Vec::with_capacity(4);
        for block in fold.parities() {
            let tensor = constant(weights, names::BLOCKS[block], &[area, values])?;
            blocks.push((block, tensor.t()?.flatten_all()?.to_vec1()?));
        }
        let [columns, rows] = fold.inner();
        let has_loads = weights.contains_tensor(names::LOADED);
        let loaded = has_loads.then(|| {
            constant(weights, names::LOADED, &[2, rows, columns])?
                .flatten_all()?
                .to_vec1()
        });
        let loaded = loaded.transpose()?;
        let strain: Vec<f32> = constant(weights, names::STRAIN, &[2])?.to_vec1()?;
        let [strain, side_mm] = strain[..] else {
            bail!("{} must have two values", names::STRAIN);
        };
        if !(strain > 0.0 && side_mm > 0.0) {
            bail!("{} is {strain} and {side_mm}: both must be above 0", names::STRAIN);
        }
        Ok(Self {
            fold,
            blocks,
            loaded,
            strain: strain.into(),
            side_mm: side_mm.into(),
        })
    }

    /// Returns the typical strain ε.
    pub(crate) fn strain(&self) -> f64 {
        self.strain
    }

    /// Returns the unit of displacement ε² L in mm.
    pub(crate) fn unit_mm(&self) -> f64 {
        self.strain * self.strain * self.side_mm
    }

    /// Returns linear responses as a tensor (n, 2, rows − 1, columns − 1) without gradient.
    pub(crate) fn tensor(&self, displacements: Vec<f32>) -> Result<Tensor> {
        let [columns, rows] = self.fold.inner();
        let n = displacements.len() / (2 * rows * columns);
        Tensor::from_vec(displacements, (n, 2, rows, columns), &Device::Cpu)
    }

    /// Exports the response to ONNX. Folding and unfolding become products with matrices of 0, 1 and −1.
    pub(crate) fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let (fold, area, values) = (self.fold, self.fold.area(), self.fold.values());
        let [width, height] = fold.corners().map(|side| side as i64);
        let mut sum: Option<Value> = None;
        for (block, weights) in &self.blocks {
            let mut folded = patterns.clone();
            if fold.is_folded(1) {
                let rows = graph.tensor(&fold.folding(1, *block)?)?;
                folded = graph.matmul(&rows, &folded);
            }
            if fold.is_folded(0) {
                let columns = graph.tensor(&fold.folding(0, *block)?.t()?.contiguous()?)?;
                folded = graph.matmul(&folded, &columns);
            }
            let folded = graph.reshape(&folded, &[0, area as i64]);
            let weights = Tensor::from_slice(weights, (values, area), &Device::Cpu)?;
            let weights = graph.tensor(&weights.t()?.contiguous()?)?;
            let part = graph.matmul(&folded, &weights);
            let mut part = graph.reshape(&part, &[0, 2, height, width]);
            if fold.is_folded(1) {
                let rows = graph.tensor(&fold.unfolding(1, *block)?)?;
                part = graph.matmul(&rows, &part);
            }
            if fold.is_folded(0) {
                let columns = graph.tensor(&fold.unfolding(0, *block)?.transpose(1, 2)?.contiguous()?)?;
                part = graph.matmul(&part, &columns);
            }
            sum = Some(match sum {
                Some(sum) => graph.add(&sum, &part),
                None => part,
            });
        }
        let Some(sum) = sum else {
            bail!("the response has no blocks")
        };
        let Some(loaded) = &self.loaded else { return Ok(sum) };
        let [columns, rows] = fold.inner();
        let loaded = graph.tensor(&Tensor::from_slice(loaded, (2, rows, columns), &Device::Cpu)?)?;
        Ok(graph.add(&sum, &loaded))
    }

    /// Computes the linear response (2, rows − 1, columns − 1) to each pattern (rows, columns), ±½ per cell.
    pub(crate) fn evaluate(&self, cells: &[f32]) -> Vec<f32> {
        let (fold, area, values) = (self.fold, self.fold.area(), self.fold.values());
        let (all, image) = (fold.raster().cells(), 2 * inner_corners(fold.raster()));
        // A product with a single column adds in another order, so a single pattern gets an empty second column.
        let n = (cells.len() / all).max(2);
        let mut folded = vec![0.0f32; n * area];
        let mut parts = vec![0.0f32; n * values];
        let mut columns = vec![0.0f32; n * values.max(area)];
        let mut displacements = vec![0.0f32; cells.len() / all * image];
        for (block, weights) in &self.blocks {
            let images = cells.chunks_exact(all);
            for (cells, folded) in images.zip(folded.chunks_exact_mut(area)) {
                dispatch(
                    #[inline(always)]
                    || fold.fold(cells, *block, folded),
                );
            }
            let patterns = &mut columns[..n * area];
            transpose(&folded, area, patterns);
            let patterns = Matrix::new(patterns, n);
            multiply(&mut parts, Accum::Replace, Matrix::new(weights, area), patterns);
            transpose(&parts, n, &mut columns[..n * values]);
            let parts = columns[..n * values].chunks_exact(values);
            for (part, displacement) in parts.zip(displacements.chunks_exact_mut(image)) {
                dispatch(
                    #[inline(always)]
                    || fold.unfold(part, *block, displacement),
                );
            }
        }
        for displacement in displacements.chunks_exact_mut(image) {
            let loaded = self.loaded.iter().flatten();
            displacement.iter_mut().zip(loaded).for_each(|(u, own)| *u += own);
        }
        displacements
    }
}

/// Transposes a matrix with rows of `columns` values in tiles, so that reads and writes stay in the cache.
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
