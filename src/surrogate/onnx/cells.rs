//! The maps between corners and cells of [`crate::layers`] as ONNX operations. The modes of a cell are a convolution
//! with 2 × 2 windows, forces its transpose, and the cells around a cell a convolution with 3 × 3 windows.

use candle_core::{Device, Result, Tensor};

use super::graph::{Attribute, Graph, Value};
use crate::corners::inner_sides;
use crate::layers::{FEATURES, Green, MODES, NEIGHBOURS, SIGNS, Supports};
use deaflow_pattern::Raster;

impl Graph {
    /// Features (n, 22, cells) of patterns (n, rows, columns) and displacements (n, 2, rows − 1, columns − 1).
    pub(crate) fn features(
        &mut self,
        raster: Raster,
        patterns: &Value,
        displacement: &Value,
        strain: f64,
    ) -> Result<Value> {
        let [columns, rows] = raster.sides().map(|side| side as i64);
        let cells = self.reshape(patterns, &[0, 1, rows, columns]);
        let around = self.tensor(&neighbour_windows()?)?;
        let around = self.padded("Conv", &cells, &around);
        let modes = self.tensor(&mode_windows(strain as f32)?)?;
        let modes = self.padded("Conv", displacement, &modes);
        let (zero, one, two) = (self.number(0.0), self.number(1.0), self.number(2.0));
        let sign = self.mul(&cells, &two);
        let signed = self.mul(&modes, &sign);
        let ones = self.mul(&cells, &zero);
        let ones = self.add(&ones, &one);
        let all = self.concatenate(&[&around, &modes, &signed, &ones], 1);
        Ok(self.reshape(&all, &[0, FEATURES as i64, rows * columns]))
    }

    /// Forces (n, 2, rows − 1, columns − 1) of stresses (n, 6, cells).
    pub(crate) fn forces(&mut self, raster: Raster, stresses: &Value) -> Result<Value> {
        let [columns, rows] = raster.sides().map(|side| side as i64);
        let stresses = self.reshape(stresses, &[0, MODES as i64, rows, columns]);
        let modes = self.tensor(&mode_windows(1.0)?)?;
        Ok(self.padded("ConvTranspose", &stresses, &modes))
    }

    /// Displacements by forces, both (n, 2, rows − 1, columns − 1).
    pub(crate) fn green(&mut self, green: &Green, forces: &Value) -> Result<Value> {
        let [along, up, inverse] = green.tables()?;
        let sines = match green.raster().is_square() {
            true => {
                let sines = self.tensor(&along)?;
                [sines.clone(), sines]
            }
            false => [self.tensor(&along)?, self.tensor(&up)?],
        };
        let inverse = self.tensor(&inverse)?;
        let moved = self.of_rectangle(&sines, &inverse, forces);
        let Some(supports) = green.supports() else {
            return Ok(moved);
        };
        let reactions = self.reactions(green.raster(), supports, &moved)?;
        let forces = self.sub(forces, &reactions);
        Ok(self.of_rectangle(&sines, &inverse, &forces))
    }

    /// Displacements without frame and bodies.
    fn of_rectangle(&mut self, sines: &[Value; 2], inverse: &Value, forces: &Value) -> Value {
        let waves = self.both_sides(sines, forces);
        let waves = self.mul(&waves, inverse);
        self.both_sides(sines, &waves)
    }

    /// Reaction forces of frame and bodies to a displacement. A matrix selects their corners.
    fn reactions(&mut self, raster: Raster, supports: &Supports, moved: &Value) -> Result<Value> {
        let [columns, rows] = inner_sides(raster);
        let (plane, count) = (columns * rows, supports.nodes.len());
        let mut selection = vec![0.0f32; 2 * plane * 2 * count];
        for component in 0..2 {
            for (at, node) in supports.nodes.iter().enumerate() {
                selection[(component * plane + node) * 2 * count + component * count + at] = 1.0;
            }
        }
        let selection = Tensor::from_vec(selection, (2 * plane, 2 * count), &Device::Cpu)?;
        let transposed = self.tensor(&selection.t()?.contiguous()?)?;
        let selection = self.tensor(&selection)?;
        let stiffness = Tensor::from_slice(&supports.stiffness, (2 * count, 2 * count), &Device::Cpu)?;
        let stiffness = self.tensor(&stiffness)?;
        let moved = self.reshape(moved, &[0, 2 * plane as i64]);
        let moved = self.matmul(&moved, &selection);
        let forces = self.matmul(&moved, &stiffness);
        let forces = self.matmul(&forces, &transposed);
        Ok(self.reshape(&forces, &[0, 2, rows as i64, columns as i64]))
    }

    fn both_sides(&mut self, [along, up]: &[Value; 2], x: &Value) -> Value {
        let x = self.matmul(x, along);
        self.matmul(up, &x)
    }

    /// A convolution or its transpose with one row of zeros on each side.
    fn padded(&mut self, operation: &str, x: &Value, weights: &Value) -> Value {
        self.node(operation, &[x, weights], &[("pads", Attribute::Integers(&[1; 4]))])
    }
}

/// Windows that select each of the 3 × 3 cells around a cell: (9, 1, 3, 3).
fn neighbour_windows() -> Result<Tensor> {
    let one = |at: usize| f32::from(u8::from(at / NEIGHBOURS == at % NEIGHBOURS));
    let values: Vec<f32> = (0..NEIGHBOURS * NEIGHBOURS).map(one).collect();
    Tensor::from_vec(values, (NEIGHBOURS, 1, 3, 3), &Device::Cpu)
}

/// Windows that compute the modes of both components times a factor: (6, 2, 2, 2).
fn mode_windows(factor: f32) -> Result<Tensor> {
    let mut values = vec![0.0f32; MODES * 2 * 4];
    for (mode, signs) in SIGNS.iter().enumerate() {
        for component in 0..2 {
            let window = values[((2 * mode + component) * 2 + component) * 4..][..4].iter_mut();
            window.zip(signs).for_each(|(value, sign)| *value = 0.5 * factor * sign);
        }
    }
    Tensor::from_vec(values, (MODES, 2, 2, 2), &Device::Cpu)
}
