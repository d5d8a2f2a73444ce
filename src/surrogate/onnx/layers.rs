//! The layers of [`crate::surrogate::layers`] as operations of a graph. Images keep their channels last here too; ONNX has
//! convolutions for channels that come first.

use candle_core::{Result, Tensor};

use super::graph::{Attribute, Graph, Value};

const CHANNELS_FIRST: [i64; 4] = [0, 3, 1, 2];
const CHANNELS_LAST: [i64; 4] = [0, 2, 3, 1];

impl Graph {
    /// As [`crate::surrogate::layers::convolve`].
    pub(crate) fn convolve(&mut self, x: &Value, weights: &Tensor, stride: usize, padding: usize) -> Result<Value> {
        self.convolution("Conv", x, weights, stride, padding)
    }

    /// As [`crate::surrogate::layers::convolve_transposed`].
    pub(crate) fn convolve_transposed(&mut self, x: &Value, weights: &Tensor) -> Result<Value> {
        let padding = (weights.dim(1)? - 1) / 2;
        self.convolution("ConvTranspose", x, weights, 2, padding)
    }

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

    /// As [`crate::surrogate::layers::mix`], for images of `side` × `side` points with `channels` channels.
    pub(crate) fn mix(&mut self, x: &Value, weights: &Tensor, side: usize, channels: usize) -> Result<Value> {
        let (groups, points, _) = weights.dims3()?;
        let (groups, points, side, channels) = (groups as i64, points as i64, side as i64, channels as i64);
        let weights = self.tensor(weights)?;
        let x = self.reshape(x, &[0, points, groups, channels / groups]);
        let x = self.transpose(&x, &[0, 2, 1, 3]);
        let y = self.matmul(&weights, &x);
        let y = self.transpose(&y, &[0, 2, 1, 3]);
        Ok(self.reshape(&y, &[0, side, side, channels]))
    }

    /// As [`crate::surrogate::layers::add_bias`].
    pub(crate) fn add_bias(&mut self, x: &Value, bias: &Tensor) -> Result<Value> {
        let bias = self.tensor(bias)?;
        Ok(self.add(x, &bias))
    }

    /// As [`crate::surrogate::layers::bias_and_activate`].
    pub(crate) fn bias_and_activate(&mut self, x: &Value, bias: &Tensor, slope: f32) -> Result<Value> {
        let x = self.add_bias(x, bias)?;
        Ok(self.node("LeakyRelu", &[&x], &[("alpha", Attribute::Float(slope))]))
    }
}
