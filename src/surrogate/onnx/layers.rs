//! The layers of [`crate::layers`] as ONNX operations. Images have channels last; ONNX convolutions need channels
//! first.

use candle_core::{Result, Tensor};

use super::Export;
use super::graph::{Attribute, Graph, Value};
use crate::layers::{Conv2d, ConvTranspose2d, Mixing};

const CHANNELS_FIRST: [i64; 4] = [0, 3, 1, 2];
const CHANNELS_LAST: [i64; 4] = [0, 2, 3, 1];

impl Export for Conv2d {
    fn export(&self, graph: &mut Graph, x: &Value) -> Result<Value> {
        let y = graph.convolution("Conv", x, &self.weights, self.config.stride, self.config.padding)?;
        graph.bias_and_activation(&y, &self.bias, Some(self.slope))
    }
}

impl Export for ConvTranspose2d {
    fn export(&self, graph: &mut Graph, x: &Value) -> Result<Value> {
        let padding = (self.weights.dim(1)? - 1) / 2;
        let y = graph.convolution("ConvTranspose", x, &self.weights, 2, padding)?;
        graph.bias_and_activation(&y, &self.bias, self.slope)
    }
}

impl Export for Mixing {
    fn export(&self, graph: &mut Graph, x: &Value) -> Result<Value> {
        let (groups, points, _) = self.weights.dims3()?;
        let [rows, columns] = self.sides.map(|side| side as i64);
        let (groups, points) = (groups as i64, points as i64);
        let weights = graph.tensor(&self.weights)?;
        let x = graph.reshape(x, &[0, points, groups, self.width as i64 / groups]);
        let x = graph.transpose(&x, &[0, 2, 1, 3]);
        let y = graph.matmul(&weights, &x);
        let y = graph.transpose(&y, &[0, 2, 1, 3]);
        Ok(graph.reshape(&y, &[0, rows, columns, self.width as i64]))
    }
}

impl Graph {
    fn convolution(
        &mut self,
        operation: &str,
        x: &Value,
        weights: &Tensor,
        stride: usize,
        padding: usize,
    ) -> Result<Value> {
        let weights = self.tensor(&weights.permute((0, 3, 1, 2))?.contiguous()?)?;
        let (stride, padding) = (stride as i64, padding as i64);
        let attributes = [
            ("strides", Attribute::Integers(&[stride; 2])),
            ("pads", Attribute::Integers(&[padding; 4])),
        ];
        let x = self.transpose(x, &CHANNELS_FIRST);
        let y = self.node(operation, &[&x, &weights], &attributes);
        Ok(self.transpose(&y, &CHANNELS_LAST))
    }

    fn bias_and_activation(&mut self, x: &Value, bias: &Tensor, slope: Option<f32>) -> Result<Value> {
        let bias = self.tensor(bias)?;
        let y = self.add(x, &bias);
        Ok(match slope {
            Some(slope) => self.node("LeakyRelu", &[&y], &[("alpha", Attribute::Float(slope))]),
            None => y,
        })
    }
}
