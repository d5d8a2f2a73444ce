//! Conversion of patterns and fields to tensors and back.

use std::ops::Range;

use candle_core::{Device, Result, Tensor};

use super::corners::Corners;
use super::example::Label;
use deaflow_field::{Field, FieldError};
use deaflow_pattern::{Pattern, Raster};

/// Inner corners along one side of the paper's membrane.
#[cfg(test)]
pub(crate) const INNER: usize = deaflow_pattern::CELLS - 1;

/// Encodes patterns as (n, rows, columns, 1). The value of a cell is the relative load of its group, 0 for a bare cell,
/// minus ½: ±½ for a single group, so that a half-covered membrane has mean zero.
pub(crate) fn patterns_to_tensor<'a>(
    raster: Raster,
    loads: &[f64],
    patterns: impl Iterator<Item = &'a Pattern>,
) -> Result<Tensor> {
    let inputs = cell_inputs(loads);
    let cells = patterns.flat_map(|pattern| pattern.cells());
    let values: Vec<f32> = cells.map(|&cell| inputs[usize::from(cell)]).collect();
    let n = values.len() / raster.cells();
    Tensor::from_vec(values, (n, raster.rows(), raster.columns(), 1), &Device::Cpu)
}

/// Returns the input value of a bare cell, then of a cell of each group.
pub(crate) fn cell_inputs(loads: &[f64]) -> Vec<f32> {
    let all = std::iter::once(&0.0).chain(loads);
    all.map(|&load| load as f32 - 0.5).collect()
}

/// Returns the range of a row of inner corners among the values of a field.
fn inner_row(raster: Raster, y: usize) -> Range<usize> {
    let columns = raster.columns();
    let first = y * (columns + 1);
    2 * (first + 1)..2 * (first + columns)
}

/// Encodes labels at corners as (n, rows of corners, columns of corners, 2) in units of `scale` mm.
pub(crate) fn labels_to_tensor(corners: Corners, labels: &[Label], scale: f64) -> Result<Tensor> {
    let [columns, rows] = corners.sides();
    let mut values = Vec::with_capacity(2 * columns * rows * labels.len());
    for label in labels {
        values.extend(label.values().iter().map(|u| (f64::from(*u) / scale) as f32));
    }
    Tensor::from_vec(values, (labels.len(), rows, columns, 2), &Device::Cpu)
}

/// Returns the x displacement at every second inner corner: (n, 49, 49, 2) to (n, 25, 25, 1).
pub(crate) fn half_resolution(fields: &Tensor) -> Result<Tensor> {
    let every_second = |axis| {
        let every_second: Vec<u32> = (0..fields.dim(axis)? as u32).step_by(2).collect();
        Tensor::new(every_second, &Device::Cpu)
    };
    let x = fields.narrow(3, 0, 1)?.contiguous()?;
    x.index_select(&every_second(1)?, 1)?.index_select(&every_second(2)?, 2)
}

/// Decodes fields in mm from (n, rows of corners, columns of corners, 2) in units of `scale` mm. Edges without outputs
/// are zero.
///
/// # Errors
/// The outer error when the tensor cannot be read; the inner error when a value is not finite.
pub(crate) fn tensor_to_fields(
    corners: Corners,
    tensor: &Tensor,
    scale: f64,
) -> Result<std::result::Result<Vec<Field>, FieldError>> {
    let ([columns, rows], raster) = (corners.sides(), corners.raster());
    let values = tensor.flatten_all()?.to_vec1::<f32>()?;
    let fields = values.chunks_exact(2 * columns * rows).map(|image| {
        if corners.held().is_some() {
            let values = image.iter().map(|v| f64::from(*v) * scale);
            return Field::from_values(raster, values.collect());
        }
        let mut values = vec![0.0; 2 * raster.corners()];
        for (y, row) in (1..).zip(image.chunks_exact(2 * columns)) {
            let inner = values[inner_row(raster, y)].iter_mut();
            inner.zip(row).for_each(|(u, v)| *u = f64::from(*v) * scale);
        }
        Field::from_values(raster, values)
    });
    Ok(fields.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_field::CORNERS;
    use deaflow_pattern::CELLS;

    #[test]
    fn fields_survive_encoding_and_decoding() {
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
        let labels = [Label::from(&field), Label::zero(Raster::PAPER)];
        let tensor = labels_to_tensor(Corners::inner(Raster::PAPER), &labels, 0.25).unwrap();
        assert_eq!(tensor.dims(), [2, INNER, INNER, 2]);
        let back = tensor_to_fields(Corners::inner(Raster::PAPER), &tensor, 0.25)
            .unwrap()
            .unwrap();
        assert_eq!(back, [field.clone(), Field::zero(Raster::PAPER)]);
        // At half resolution: the x displacement at the odd corners.
        let half = half_resolution(&tensor).unwrap();
        assert_eq!(half.dims(), [2, 25, 25, 1]);
        let corner = half.flatten_all().unwrap().to_vec1::<f32>().unwrap()[3 * 25 + 24];
        assert_eq!(f64::from(corner) * 0.25, field.at_corner(49, 7)[0]);
    }

    #[test]
    fn fields_of_devices_with_free_sides_survive_at_all_corners() {
        let raster = Raster::new(5, 3).unwrap();
        let corners = Corners::all(raster, [[true; 2], [false; 2], [false; 2], [false; 2]]);
        let value = |i: usize| {
            if (i / 2).is_multiple_of(6) {
                0.0
            } else {
                ((i * 37 % 101) as f64 - 50.0) / 32.0
            }
        };
        let field = Field::from_values(raster, (0..2 * raster.corners()).map(value).collect()).unwrap();
        let label = Label::at(corners, field.values()).unwrap();
        let tensor = labels_to_tensor(corners, &[label], 0.25).unwrap();
        assert_eq!(tensor.dims(), [1, 4, 6, 2]);
        assert_eq!(tensor_to_fields(corners, &tensor, 0.25).unwrap().unwrap(), [field]);
    }

    #[test]
    fn cells_have_the_relative_load_of_their_group() {
        let raster = Raster::new(3, 1).unwrap();
        let pattern = Pattern::from_groups(raster, |x, _| x as u8);
        let tensor = patterns_to_tensor(raster, &[1.0, 0.25], [&pattern].into_iter()).unwrap();
        let values = tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(values, [-0.5, 0.5, -0.25]);
    }

    #[test]
    fn patterns_become_plus_and_minus_one_half() {
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| x == 3 && y == 1);
        let tensor = patterns_to_tensor(Raster::PAPER, &[1.0], [&pattern].into_iter()).unwrap();
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
