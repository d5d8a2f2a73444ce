//! A network of a device with sides that are not held: one of patterns with a rim of one more cell, which is neither
//! bare nor electrode, so that its outputs are at all corners. Components that sides hold are zero.

use candle_core::{Device, Module, Result, Tensor};

use super::{Network, Output};
use crate::corners::Corners;
use crate::onnx::{Export, Graph, Value};

/// A network on patterns with a rim.
pub(super) struct Open<N> {
    network: N,
    /// 0 for components that a side holds, (1, rows + 1, columns + 1, 2).
    movable: Tensor,
}

impl<N: Network> Open<N> {
    /// Wraps a network of the raster with the rim.
    pub(super) fn new(network: N, corners: Corners) -> Result<Self> {
        let [columns, rows] = corners.sides();
        let movable = Tensor::from_vec(corners.movable(), (1, rows, columns, 2), &Device::Cpu)?;
        Ok(Self { network, movable })
    }
}

/// Adds the rim to patterns.
fn with_rim(patterns: &Tensor) -> Result<Tensor> {
    patterns.pad_with_zeros(1, 1, 1)?.pad_with_zeros(2, 1, 1)?.contiguous()
}

impl<N: Network> Module for Open<N> {
    fn forward(&self, patterns: &Tensor) -> Result<Tensor> {
        self.network.forward(&with_rim(patterns)?)?.broadcast_mul(&self.movable)
    }
}

impl<N: Network> Network for Open<N> {
    fn frozen(&self, patterns: &Tensor) -> Result<Option<Vec<f32>>> {
        self.network.frozen(&with_rim(patterns)?)
    }

    fn forward_for_training(&self, patterns: &Tensor, frozen: Option<&[f32]>) -> Result<Output> {
        let output = self.network.forward_for_training(&with_rim(patterns)?, frozen)?;
        Ok(Output {
            displacement: output.displacement.broadcast_mul(&self.movable)?,
            ..output
        })
    }

    fn patterns_per_thread(&self) -> usize {
        self.network.patterns_per_thread()
    }

    fn examples_per_part(&self) -> usize {
        self.network.examples_per_part()
    }

    fn unit_mm(&self) -> Option<f64> {
        self.network.unit_mm()
    }
}

impl<N: Network> Export for Open<N> {
    fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let with_rim = graph.pad(patterns, &[0, 1, 1, 0, 0, 1, 1, 0]);
        let all = self.network.export(graph, &with_rim)?;
        let movable = graph.tensor(&self.movable)?;
        Ok(graph.mul(&all, &movable))
    }
}
