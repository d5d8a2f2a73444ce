//! The steps of a correction as separate candle operations: the reference for the fused operation in tests.

use candle_core::{Device, Module, Result, Tensor};
use candle_nn::Linear;

use super::cell::{FEATURES, MODES, NEIGHBOURS, SIGNS};
use super::green::Green;
use deaflow_pattern::Raster;

/// Returns small integers, so that sums are exact in f32.
pub(super) fn numbers(dims: &[usize], salt: usize) -> Tensor {
    let count = dims.iter().product();
    let values: Vec<f32> = (0..count).map(|i| ((i * 31 + salt) * 17 % 11) as f32 - 5.0).collect();
    Tensor::from_vec(values, dims, &Device::Cpu).unwrap()
}

/// Returns the features (n, 22, cells) of patterns (n, rows, columns), ±½ per cell, and displacements
/// (n, 2, rows − 1, columns − 1).
pub(super) fn features(patterns: &Tensor, displacement: &Tensor, strain: f64) -> Result<Tensor> {
    let (n, rows, columns) = patterns.dims3()?;
    let area = rows * columns;
    let padded = patterns.pad_with_zeros(1, 1, 1)?.pad_with_zeros(2, 1, 1)?;
    let mut channels = Vec::with_capacity(FEATURES);
    for at in 0..NEIGHBOURS {
        let shifted = padded.narrow(1, at / 3, rows)?.narrow(2, at % 3, columns)?;
        channels.push(shifted.reshape((n, 1, area))?);
    }
    let modes = (modes(displacement)? * strain)?;
    let sign = (patterns.reshape((n, 1, area))? * 2.0)?;
    let signed = modes.broadcast_mul(&sign)?;
    channels.extend([modes, signed, sign.ones_like()?]);
    Tensor::cat(&channels, 1)
}

/// Returns the modes (n, 6, cells) of displacements (n, 2, rows − 1, columns − 1).
pub(super) fn modes(displacement: &Tensor) -> Result<Tensor> {
    let (n, _, rows, columns) = displacement.dims4()?;
    let (rows, columns) = (rows + 1, columns + 1);
    let padded = displacement.pad_with_zeros(2, 1, 1)?.pad_with_zeros(3, 1, 1)?;
    let corner = |at: usize| padded.narrow(2, at / 2, rows)?.narrow(3, at % 2, columns);
    let corners = [corner(0)?, corner(1)?, corner(2)?, corner(3)?];
    let mode = |signs: &[f32; 4]| -> Result<Tensor> {
        let mut sum = (&corners[0] * f64::from(signs[0] / 2.0))?;
        for (corner, sign) in corners.iter().zip(signs).skip(1) {
            sum = (sum + (corner * f64::from(sign / 2.0))?)?;
        }
        sum.reshape((n, 2, rows * columns))
    };
    Tensor::cat(&[mode(&SIGNS[0])?, mode(&SIGNS[1])?, mode(&SIGNS[2])?], 1)
}

/// Returns the stresses (n, 6, cells) of features (n, 22, cells). `factors` and `stresses` are as in
/// [`super::StressLaw`].
pub(super) fn law(features: &Tensor, factors: &Tensor, stresses: &Tensor) -> Result<Tensor> {
    let features = features.transpose(1, 2)?.contiguous()?;
    let factors = Linear::new(factors.clone(), None).forward(&features)?;
    let halves = factors.chunk(2, 2)?;
    let products = (&halves[0] * &halves[1])?;
    let seen = Tensor::cat(&[products, features], 2)?;
    Linear::new(stresses.clone(), None).forward(&seen)?.transpose(1, 2)
}

/// Returns the forces (n, 2, rows − 1, columns − 1) of stresses (n, 6, cells) at the inner corners.
pub(super) fn forces(raster: Raster, stresses: &Tensor) -> Result<Tensor> {
    let [columns, rows] = raster.sides();
    let n = stresses.dim(0)?;
    let stresses = stresses.contiguous()?.reshape((n, MODES / 2, 2, rows, columns))?;
    let at_corner = |corner: usize| -> Result<Tensor> {
        let mut sum = Tensor::zeros((n, 2, rows, columns), stresses.dtype(), stresses.device())?;
        for (mode, signs) in SIGNS.iter().enumerate() {
            sum = (sum + (stresses.narrow(1, mode, 1)?.squeeze(1)? * f64::from(signs[corner] / 2.0))?)?;
        }
        let (row, column) = (corner / 2, corner % 2);
        sum.pad_with_zeros(2, row, 1 - row)?
            .pad_with_zeros(3, column, 1 - column)
    };
    let all = (((at_corner(0)? + at_corner(1)?)? + at_corner(2)?)? + at_corner(3)?)?;
    all.narrow(2, 1, rows - 1)?.narrow(3, 1, columns - 1)
}

/// Returns the displacements by forces, both (n, 2, rows − 1, columns − 1), on a rectangle.
pub(super) fn green(green: &Green, forces: &Tensor) -> Result<Tensor> {
    let [along, up, inverse] = green.tables()?;
    let transformed = |x: &Tensor| up.broadcast_matmul(&x.contiguous()?.broadcast_matmul(&along)?);
    transformed(&transformed(forces)?.broadcast_mul(&inverse)?)
}
