//! What lies between corners and cells as operations of a graph, as [`crate::surrogate::layers`] has it. The modes of a cell are a
//! convolution with 2 × 2 windows, forces its transpose, and the cells around a cell one with 3 × 3 windows.

use candle_core::{Device, Result, Tensor};

use super::graph::{Attribute, Graph, Value};
use crate::pattern::CELLS;
use crate::surrogate::layers::{FEATURES, MODES, NEIGHBOURS, SIGNS, green_tables};

const SIDE: i64 = CELLS as i64;
const AREA: i64 = (CELLS * CELLS) as i64;

impl Graph {
    /// What a local law sees of patterns (n, 50, 50) and displacements (n, 2, 49, 49): (n, 22, 2500).
    pub(crate) fn features(&mut self, patterns: &Value, displacement: &Value, strain: f64) -> Result<Value> {
        let cells = self.reshape(patterns, &[0, 1, SIDE, SIDE]);
        let around = self.tensor(&places()?)?;
        let around = self.framed("Conv", &cells, &around);
        let modes = self.tensor(&modes(strain as f32)?)?;
        let modes = self.framed("Conv", displacement, &modes);
        let (zero, one, two) = (self.number(0.0), self.number(1.0), self.number(2.0));
        let sign = self.mul(&cells, &two);
        let signed = self.mul(&modes, &sign);
        let ones = self.mul(&cells, &zero);
        let ones = self.add(&ones, &one);
        let all = self.concatenate(&[&around, &modes, &signed, &ones], 1);
        Ok(self.reshape(&all, &[0, FEATURES as i64, AREA]))
    }

    /// The forces (n, 2, 49, 49) of stresses (n, 6, 2500).
    pub(crate) fn forces(&mut self, stresses: &Value) -> Result<Value> {
        let stresses = self.reshape(stresses, &[0, MODES as i64, SIDE, SIDE]);
        let modes = self.tensor(&modes(1.0)?)?;
        Ok(self.framed("ConvTranspose", &stresses, &modes))
    }

    /// The displacements that forces cause, both (n, 2, 49, 49).
    pub(crate) fn green(&mut self, forces: &Value) -> Result<Value> {
        let (sines, inverse) = green_tables()?;
        let (sines, inverse) = (self.tensor(&sines)?, self.tensor(&inverse)?);
        let waves = self.both_sides(&sines, forces);
        let waves = self.mul(&waves, &inverse);
        Ok(self.both_sides(&sines, &waves))
    }

    fn both_sides(&mut self, sines: &Value, x: &Value) -> Value {
        let x = self.matmul(x, sines);
        self.matmul(sines, &x)
    }

    /// A convolution or its transpose, with one row of zeros around the corners or cells.
    fn framed(&mut self, operation: &str, x: &Value, weights: &Value) -> Value {
        self.node(operation, &[x, weights], &[("pads", Attribute::Integers(&[1; 4]))])
    }
}

/// Windows that show the 3 × 3 cells around a cell, one each: (9, 1, 3, 3).
fn places() -> Result<Tensor> {
    let one = |at: usize| f32::from(u8::from(at / NEIGHBOURS == at % NEIGHBOURS));
    let values: Vec<f32> = (0..NEIGHBOURS * NEIGHBOURS).map(one).collect();
    Tensor::from_vec(values, (NEIGHBOURS, 1, 3, 3), &Device::Cpu)
}

/// Windows that show the modes of both components times a factor: (6, 2, 2, 2).
fn modes(factor: f32) -> Result<Tensor> {
    let mut values = vec![0.0f32; MODES * 2 * 4];
    for (mode, signs) in SIGNS.iter().enumerate() {
        for component in 0..2 {
            let window = &mut values[((2 * mode + component) * 2 + component) * 4..][..4];
            window
                .iter_mut()
                .zip(signs)
                .for_each(|(value, sign)| *value = 0.5 * factor * sign);
        }
    }
    Tensor::from_vec(values, (MODES, 2, 2, 2), &Device::Cpu)
}
