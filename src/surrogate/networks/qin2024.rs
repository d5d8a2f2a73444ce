//! The network of Qin, Ren, Chen, Zou & Gu, "Automatic design framework of dielectric elastomer actuators" (Soft Robotics
//! 2024, doi 10.1089/soro.2024.0063).
//!
//! The paper gives its parts: an encoder of five convolutions with large kernels first, a bottleneck, two parallel
//! decoders of three layers for the x and y displacement, and an auxiliary branch that answers x at half resolution. It
//! gives no widths (its supplement is not public); those below, chosen by measurement, predict a thousand patterns in a
//! second on two cores.
//!
//! The grids of the layers share their points. The first layer has an even window, so it looks from cells at corners: its
//! 25 × 25 outputs lie on the odd corners 1, 3, …, 49, the 13 × 13 outputs of the second on 1, 5, …, 49, and the decoders
//! go back by the transposed maps 13 → 25 → 49, whose outputs are all inner corners. The bottleneck mixes over the whole
//! membrane, because the elastic response is global. Layers that keep grid and width add to what they are given (He et al.,
//! CVPR 2016), which training follows more easily.
//!
//! Sides of 4k − 2 cells have such grids. Patterns of others are continued by zeros, which are neither bare nor electrode, to the right and
//! above, and corners beyond their own are left out of the answer. Only the matrices of the bottleneck depend on the number of cells.

use candle_core::{Module, Result, Tensor, bail};
use candle_nn::{Conv2dConfig, VarBuilder};

use super::{Network, Output};
use crate::layers::{Conv2d, ConvTranspose2d, Mixing};
use crate::onnx::{Export, Graph, Value};
use deaflow_pattern::Raster;

/// Channels after the first and second layer of the encoder, and from the third on.
const ENCODER: [usize; 3] = [16, 32, 64];
/// Channels after the first and second layer of a decoder; the third answers.
const DECODER: [usize; 2] = [32, 16];
/// Channels of the auxiliary branch.
const AUXILIARY: usize = 16;
/// The most numbers of the matrices in the bottleneck, a quarter of a gigabyte: 200 × 200 cells.
const MOST: usize = 1 << 26;
/// Groups of channels in the bottleneck, each mixed by a matrix of its own.
const GROUPS: usize = 8;
/// Side of the window of a layer that answers or enlarges.
const ENLARGE: usize = 5;
/// Slope of the activation below zero. It is far from the usual 0.01 to 0.2 because the elastic response is close to linear
/// in the pattern: with a thousand examples and eight epochs, slopes of 0.1, 0.4 and 0.7 left 0.035, 0.029 and 0.026 mm.
const SLOPE: f32 = 0.7;
/// The layers that answer start with small weights: a training then begins near the mean answer, zero.
const ANSWER_GAIN: f64 = 0.3;

/// The network.
pub(super) struct Qin2024 {
    grid: Grid,
    encoder: [Conv2d; 5],
    bottleneck: Bottleneck,
    x: Decoder,
    y: Decoder,
    auxiliary: (Conv2d, ConvTranspose2d),
}

impl Qin2024 {
    /// The network for patterns of these cells on the given weights.
    pub(super) fn new(weights: &VarBuilder<'_>, raster: Raster) -> Result<Self> {
        let grid = Grid::new(raster)?;
        let [first, second, wide] = ENCODER;
        let layer = |name: &str, channels, window| convolution(channels, window, &weights.pp(name));
        Ok(Self {
            grid,
            encoder: [
                layer("encoder.1", [1, first], Window(10, 2, 4))?,
                layer("encoder.2", [first, second], Window(7, 2, 3))?,
                layer("encoder.3", [second, wide], Window(5, 1, 2))?,
                layer("encoder.4", [wide, wide], Window(3, 1, 1))?,
                layer("encoder.5", [wide, wide], Window(3, 1, 1))?,
            ],
            bottleneck: Bottleneck::new(grid, wide, &weights.pp("bottleneck"))?,
            x: Decoder::new(wide, &weights.pp("x"))?,
            y: Decoder::new(wide, &weights.pp("y"))?,
            auxiliary: (
                layer("auxiliary.1", [wide, AUXILIARY], Window(3, 1, 1))?,
                last([AUXILIARY, 1], &weights.pp("auxiliary.2"))?,
            ),
        })
    }

    /// What the decoders and the auxiliary branch start from.
    fn features(&self, patterns: &Tensor) -> Result<Tensor> {
        let [first, second, third, fourth, fifth] = &self.encoder;
        let features = self.grid.continued(patterns)?;
        let features = features.apply(first)?.apply(second)?.apply(third)?;
        let features = (&features + features.apply(fourth)?)?;
        let features = (&features + features.apply(fifth)?)?;
        features.apply(&self.bottleneck)
    }

    fn decode(&self, features: &Tensor) -> Result<Tensor> {
        let both = Tensor::cat(&[features.apply(&self.x)?, features.apply(&self.y)?], 3)?;
        self.grid.cut(&both, 1)
    }
}

impl Module for Qin2024 {
    fn forward(&self, patterns: &Tensor) -> Result<Tensor> {
        self.decode(&self.features(patterns)?)
    }
}

impl Network for Qin2024 {
    fn forward_for_training(&self, patterns: &Tensor, _: Option<&[f32]>) -> Result<Output> {
        let features = self.features(patterns)?;
        let (first, second) = &self.auxiliary;
        Ok(Output {
            displacement: self.decode(&features)?,
            half_resolution: Some(self.grid.cut(&features.apply(first)?.apply(second)?, 2)?),
        })
    }
}

impl Export for Qin2024 {
    fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let [first, second, third, fourth, fifth] = &self.encoder;
        let features = match self.grid.added() {
            [0, 0] => patterns.clone(),
            [right, above] => graph.pad(patterns, &[0, 0, 0, 0, 0, above as i64, right as i64, 0]),
        };
        let features = first.export(graph, &features)?;
        let features = second.export(graph, &features)?;
        let mut features = third.export(graph, &features)?;
        for layer in [fourth, fifth] {
            let more = layer.export(graph, &features)?;
            features = graph.add(&features, &more);
        }
        let features = self.bottleneck.export(graph, &features)?;
        let (x, y) = (self.x.export(graph, &features)?, self.y.export(graph, &features)?);
        let both = graph.concatenate(&[&x, &y], 3);
        let [columns, rows] = self.grid.raster.sides().map(|side| side - 1);
        Ok(match self.grid.added() {
            [0, 0] => both,
            _ => graph.first(&both, [rows, columns]),
        })
    }
}

/// The grids of a network for some cells.
#[derive(Clone, Copy)]
struct Grid {
    raster: Raster,
    /// Columns and rows of the grid in the bottleneck.
    coarse: [usize; 2],
}

impl Grid {
    fn new(raster: Raster) -> Result<Self> {
        if raster.sides().contains(&1) {
            bail!("nothing moves on {raster} cells: there is nothing to learn");
        }
        let coarse = raster.sides().map(|side| (side + 2).div_ceil(4));
        let numbers = GROUPS * (coarse[0] * coarse[1]).pow(2);
        if numbers > MOST {
            bail!(
                "the network qin2024 for {raster} cells has matrices of {numbers} numbers, and at most {MOST} are allowed: fewer cells, \
                 about 200 × 200"
            );
        }
        Ok(Self { raster, coarse })
    }

    /// Cells by which patterns are continued, to the right and above.
    fn added(self) -> [usize; 2] {
        [0, 1].map(|axis| 4 * self.coarse[axis] - 2 - self.raster.sides()[axis])
    }

    /// Patterns with as many cells as the grids have.
    fn continued(self, patterns: &Tensor) -> Result<Tensor> {
        match self.added() {
            [0, 0] => Ok(patterns.clone()),
            [right, above] => patterns
                .pad_with_zeros(1, 0, above)?
                .pad_with_zeros(2, 0, right)?
                .contiguous(),
        }
    }

    /// Every so many-th inner corner, without those beyond the membrane.
    fn cut(self, answer: &Tensor, step: usize) -> Result<Tensor> {
        match self.added() {
            [0, 0] => Ok(answer.clone()),
            _ => {
                let [columns, rows] = self.raster.sides().map(|side| (side - 1).div_ceil(step));
                answer.narrow(1, 0, rows)?.narrow(2, 0, columns)?.contiguous()
            }
        }
    }
}

/// Side, stride and padding of a window.
struct Window(usize, usize, usize);

fn convolution(channels: [usize; 2], window: Window, weights: &VarBuilder<'_>) -> Result<Conv2d> {
    let Window(side, stride, padding) = window;
    let config = Conv2dConfig {
        stride,
        padding,
        ..Conv2dConfig::default()
    };
    Conv2d::new(channels, side, config, he(channels[0] * side * side), SLOPE, weights)
}

/// A layer that maps a grid of n × n points to (2n − 1) × (2n − 1).
fn enlargement(channels: [usize; 2], weights: &VarBuilder<'_>) -> Result<ConvTranspose2d> {
    ConvTranspose2d::new(channels, ENLARGE, he(enlarged(channels)), Some(SLOPE), weights)
}

/// The same as the last layer of a branch.
fn last(channels: [usize; 2], weights: &VarBuilder<'_>) -> Result<ConvTranspose2d> {
    ConvTranspose2d::new(channels, ENLARGE, ANSWER_GAIN * he(enlarged(channels)), None, weights)
}

/// Inputs of an output of an enlargement. A quarter of the window falls on them: the others are the gaps between them.
fn enlarged([from, _]: [usize; 2]) -> usize {
    from * ENLARGE * ENLARGE / 4
}

/// He's standard deviation for a layer with leaky rectified outputs (He et al., ICCV 2015, eq. 15).
fn he(fan_in: usize) -> f64 {
    (2.0 / ((1.0 + f64::from(SLOPE).powi(2)) * fan_in as f64)).sqrt()
}

/// Mixes every channel over the whole grid, then the channels at every point, and adds the result to what came in.
struct Bottleneck {
    mixing: Mixing,
    channels: Conv2d,
}

impl Bottleneck {
    fn new(grid: Grid, width: usize, weights: &VarBuilder<'_>) -> Result<Self> {
        let [columns, rows] = grid.coarse;
        Ok(Self {
            mixing: Mixing::new(GROUPS, [rows, columns], width, weights)?,
            channels: convolution([width, width], Window(1, 1, 0), &weights.pp("channels"))?,
        })
    }
}

impl Module for Bottleneck {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        x + x.apply(&self.mixing)?.apply(&self.channels)?
    }
}

impl Export for Bottleneck {
    fn export(&self, graph: &mut Graph, x: &Value) -> Result<Value> {
        let mixed = self.mixing.export(graph, x)?;
        let more = self.channels.export(graph, &mixed)?;
        Ok(graph.add(x, &more))
    }
}

/// From the bottleneck to one component of the displacement at all inner corners.
struct Decoder {
    first: Conv2d,
    second: ConvTranspose2d,
    third: ConvTranspose2d,
}

impl Decoder {
    fn new(width: usize, weights: &VarBuilder<'_>) -> Result<Self> {
        let [first, second] = DECODER;
        Ok(Self {
            first: convolution([width, first], Window(3, 1, 1), &weights.pp("1"))?,
            second: enlargement([first, second], &weights.pp("2"))?,
            third: last([second, 1], &weights.pp("3"))?,
        })
    }
}

impl Module for Decoder {
    fn forward(&self, features: &Tensor) -> Result<Tensor> {
        features.apply(&self.first)?.apply(&self.second)?.apply(&self.third)
    }
}

impl Export for Decoder {
    fn export(&self, graph: &mut Graph, features: &Value) -> Result<Value> {
        let y = self.first.export(graph, features)?;
        let y = self.second.export(graph, &y)?;
        self.third.export(graph, &y)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use candle_core::{DType, Device};

    use super::*;
    use crate::parameters::Drawn;

    #[test]
    fn any_raster_has_an_answer_at_each_inner_corner() {
        let constants = BTreeMap::new();
        for (columns, rows) in [(40, 24), (6, 10), (7, 3), (2, 9)] {
            let raster = Raster::new(columns, rows).unwrap();
            let weights = Drawn::new(&constants, 1);
            let network = Qin2024::new(&weights.builder(), raster).unwrap();
            let patterns = Tensor::zeros((2, rows, columns, 1), DType::F32, &Device::Cpu).unwrap();
            let output = network.forward_for_training(&patterns, None).unwrap();
            assert_eq!(output.displacement.dims(), [2, rows - 1, columns - 1, 2]);
            let half = output.half_resolution.unwrap();
            assert_eq!(half.dims(), [2, rows / 2, columns / 2, 1]);
        }
    }

    #[test]
    fn rasters_without_a_network_are_refused() {
        let constants = BTreeMap::new();
        for (sides, says) in [((1, 9), "nothing moves"), ((400, 400), "fewer cells")] {
            let raster = Raster::new(sides.0, sides.1).unwrap();
            let error = Qin2024::new(&Drawn::new(&constants, 1).builder(), raster)
                .err()
                .unwrap();
            assert!(error.to_string().contains(says), "{error}");
        }
    }
}
