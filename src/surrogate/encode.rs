//! Patterns and fields as tensors, and back.
//!
//! The frame does not move, so networks answer on the 49 × 49 inner corners only and the frame is exactly zero.

use std::ops::Range;

use candle_core::{Device, Result, Tensor};

use super::example::Label;
use crate::field::{CORNERS, Field, FieldError};
use crate::pattern::{CELLS, Pattern, Raster};

/// Corners along one side without the frame.
pub(crate) const INNER: usize = CORNERS - 2;

/// Patterns as (n, 50, 50, 1): ½ on the electrode, −½ off it, so that a half-covered membrane has mean zero.
pub(crate) fn patterns_to_tensor<'a>(patterns: impl Iterator<Item = &'a Pattern>) -> Result<Tensor> {
    let values: Vec<f32> = patterns.flat_map(|p| p.cells()).map(|&c| f32::from(c) - 0.5).collect();
    let n = values.len() / (CELLS * CELLS);
    Tensor::from_vec(values, (n, CELLS, CELLS, 1), &Device::Cpu)
}

/// The values of one row of inner corners.
fn inner_row(y: usize) -> Range<usize> {
    2 * (y * CORNERS + 1)..2 * (y * CORNERS + 1 + INNER)
}

/// Labels as (n, 49, 49, 2), divided by `scale` (mm).
pub(crate) fn labels_to_tensor<'a>(labels: impl Iterator<Item = &'a Label>, scale: f64) -> Result<Tensor> {
    let scaled = |u: &f32| (f64::from(*u) / scale) as f32;
    let values: Vec<f32> = labels.flat_map(Label::values).map(scaled).collect();
    let n = values.len() / (2 * INNER * INNER);
    Tensor::from_vec(values, (n, INNER, INNER, 2), &Device::Cpu)
}

/// The x displacement at every second inner corner, (n, 25, 25, 1), of fields as (n, 49, 49, 2).
pub(crate) fn half_resolution(fields: &Tensor) -> Result<Tensor> {
    let every_second: Vec<u32> = (0..INNER as u32).step_by(2).collect();
    let index = Tensor::new(every_second, &Device::Cpu)?;
    let x = fields.narrow(3, 0, 1)?.contiguous()?;
    x.index_select(&index, 1)?.index_select(&index, 2)
}

/// Fields in mm from (n, 49, 49, 2) in units of `scale`.
///
/// # Errors
/// The outer one when the tensor cannot be read, the inner one when a value is not finite.
pub(crate) fn tensor_to_fields(tensor: &Tensor, scale: f64) -> Result<std::result::Result<Vec<Field>, FieldError>> {
    let values = tensor.flatten_all()?.to_vec1::<f32>()?;
    let fields = values.chunks_exact(2 * INNER * INNER).map(|image| {
        let mut values = vec![0.0; CORNERS * CORNERS * 2];
        for (y, row) in (1..).zip(image.chunks_exact(2 * INNER)) {
            values[inner_row(y)]
                .iter_mut()
                .zip(row)
                .for_each(|(u, v)| *u = f64::from(*v) * scale);
        }
        Field::from_values(Raster::PAPER, values)
    });
    Ok(fields.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Raster;

    #[test]
    fn a_field_survives_the_way_to_a_tensor_and_back() {
        let value = |i: usize| {
            let (x, y) = (i / 2 % CORNERS, i / 2 / CORNERS);
            let inside = (1..=INNER).contains(&x) && (1..=INNER).contains(&y);
            if inside {
                ((i * 37 % 101) as f64 - 50.0) / 32.0
            } else {
                0.0
            }
        };
        let field = Field::from_values(Raster::PAPER, (0..CORNERS * CORNERS * 2).map(value).collect()).unwrap();
        let labels = [Label::from(&field), Label::zero()];
        let tensor = labels_to_tensor(labels.iter(), 0.25).unwrap();
        assert_eq!(tensor.dims(), [2, INNER, INNER, 2]);
        let back = tensor_to_fields(&tensor, 0.25).unwrap().unwrap();
        assert_eq!(back, [field.clone(), Field::zero(Raster::PAPER)]);
        // The half resolution holds the x displacement at the odd corners.
        let half = half_resolution(&tensor).unwrap();
        assert_eq!(half.dims(), [2, 25, 25, 1]);
        let corner = half.flatten_all().unwrap().to_vec1::<f32>().unwrap()[3 * 25 + 24];
        assert_eq!(f64::from(corner) * 0.25, field.at_corner(49, 7)[0]);
    }

    #[test]
    fn patterns_become_plus_and_minus_one_half() {
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| x == 3 && y == 1);
        let tensor = patterns_to_tensor([&pattern].into_iter()).unwrap();
        assert_eq!(tensor.dims(), [1, CELLS, CELLS, 1]);
        let values = tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert!(
            values
                .iter()
                .enumerate()
                .all(|(at, v)| *v == if at == CELLS + 3 { 0.5 } else { -0.5 })
        );
    }
}
