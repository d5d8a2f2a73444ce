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

use candle_core::{Result, Tensor};

use super::{Network, Output};
use crate::surrogate::layers::{add_bias, bias_and_activate, convolve, convolve_transposed, mix};
use crate::surrogate::onnx::{Graph, Value};
use crate::surrogate::parameters::Parameters;

/// Channels after the first and second layer of the encoder, and from the third on.
const ENCODER: [usize; 3] = [16, 32, 64];
/// Channels after the first and second layer of a decoder; the third answers.
const DECODER: [usize; 2] = [32, 16];
/// Channels of the auxiliary branch.
const AUXILIARY: usize = 16;
/// Side of the grid in the bottleneck.
const COARSE: usize = 13;
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
    encoder: [Convolution; 5],
    bottleneck: Bottleneck,
    x: Decoder,
    y: Decoder,
    auxiliary: (Convolution, Enlargement),
}

impl Qin2024 {
    /// The network on the given weights.
    pub(super) fn new(p: &mut Parameters) -> Result<Self> {
        let [first, second, wide] = ENCODER;
        Ok(Self {
            encoder: [
                Convolution::new(p, "encoder.1", [1, first], Window(10, 2, 4))?,
                Convolution::new(p, "encoder.2", [first, second], Window(7, 2, 3))?,
                Convolution::new(p, "encoder.3", [second, wide], Window(5, 1, 2))?,
                Convolution::new(p, "encoder.4", [wide, wide], Window(3, 1, 1))?,
                Convolution::new(p, "encoder.5", [wide, wide], Window(3, 1, 1))?,
            ],
            bottleneck: Bottleneck::new(p, wide)?,
            x: Decoder::new(p, "x", wide)?,
            y: Decoder::new(p, "y", wide)?,
            auxiliary: (
                Convolution::new(p, "auxiliary.1", [wide, AUXILIARY], Window(3, 1, 1))?,
                Enlargement::new(p, "auxiliary.2", [AUXILIARY, 1], ANSWER_GAIN)?,
            ),
        })
    }
}

impl Network for Qin2024 {
    fn forward(&self, patterns: &Tensor, auxiliary: bool) -> Result<Output> {
        let [first, second, third, fourth, fifth] = &self.encoder;
        let features = third.forward(&second.forward(&first.forward(patterns)?)?)?;
        let features = (&features + fourth.forward(&features)?)?;
        let features = (&features + fifth.forward(&features)?)?;
        let features = self.bottleneck.forward(&features)?;
        let displacement = Tensor::cat(&[self.x.forward(&features)?, self.y.forward(&features)?], 3)?;
        let half_resolution = if auxiliary {
            let (first, second) = &self.auxiliary;
            Some(second.answer(&first.forward(&features)?)?)
        } else {
            None
        };
        Ok(Output {
            displacement,
            half_resolution,
        })
    }

    fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let [first, second, third, fourth, fifth] = &self.encoder;
        let features = first.export(graph, patterns)?;
        let features = second.export(graph, &features)?;
        let mut features = third.export(graph, &features)?;
        for layer in [fourth, fifth] {
            let more = layer.export(graph, &features)?;
            features = graph.add(&features, &more);
        }
        let mixed = graph.mix(&features, &self.bottleneck.mixing, COARSE, ENCODER[2])?;
        let more = self.bottleneck.channels.export(graph, &mixed)?;
        let features = graph.add(&features, &more);
        let (x, y) = (self.x.export(graph, &features)?, self.y.export(graph, &features)?);
        Ok(graph.concatenate(&[&x, &y], 3))
    }
}

/// Side, stride and padding of a window.
struct Window(usize, usize, usize);

/// A convolution with bias and activation.
struct Convolution {
    weights: Tensor,
    bias: Tensor,
    stride: usize,
    padding: usize,
}

impl Convolution {
    fn new(p: &mut Parameters, name: &str, [from, to]: [usize; 2], window: Window) -> Result<Self> {
        let Window(side, stride, padding) = window;
        let deviation = he(from * side * side);
        Ok(Self {
            weights: p.tensor(&format!("{name}.weights"), &[to, side, side, from], deviation)?,
            bias: p.tensor(&format!("{name}.bias"), &[to], 0.0)?,
            stride,
            padding,
        })
    }

    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        bias_and_activate(
            &convolve(x, &self.weights, self.stride, self.padding)?,
            &self.bias,
            SLOPE,
        )
    }

    fn export(&self, graph: &mut Graph, x: &Value) -> Result<Value> {
        let y = graph.convolve(x, &self.weights, self.stride, self.padding)?;
        graph.bias_and_activate(&y, &self.bias, SLOPE)
    }
}

/// A transposed convolution that maps a grid of n × n points to (2n − 1) × (2n − 1).
struct Enlargement {
    weights: Tensor,
    bias: Tensor,
}

impl Enlargement {
    fn new(p: &mut Parameters, name: &str, [from, to]: [usize; 2], gain: f64) -> Result<Self> {
        // A quarter of the window falls on inputs: the others are the gaps between them.
        let deviation = gain * he(from * ENLARGE * ENLARGE / 4);
        Ok(Self {
            weights: p.tensor(&format!("{name}.weights"), &[from, ENLARGE, ENLARGE, to], deviation)?,
            bias: p.tensor(&format!("{name}.bias"), &[to], 0.0)?,
        })
    }

    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        bias_and_activate(&convolve_transposed(x, &self.weights)?, &self.bias, SLOPE)
    }

    fn answer(&self, x: &Tensor) -> Result<Tensor> {
        add_bias(&convolve_transposed(x, &self.weights)?, &self.bias)
    }
}

/// Mixes every channel over the whole grid, then the channels at every point, and adds the result to what came in.
struct Bottleneck {
    mixing: Tensor,
    channels: Convolution,
}

impl Bottleneck {
    fn new(p: &mut Parameters, width: usize) -> Result<Self> {
        let points = COARSE * COARSE;
        Ok(Self {
            mixing: p.tensor(
                "bottleneck.mixing",
                &[GROUPS, points, points],
                (1.0 / points as f64).sqrt(),
            )?,
            channels: Convolution::new(p, "bottleneck.channels", [width, width], Window(1, 1, 0))?,
        })
    }

    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        x + self.channels.forward(&mix(x, &self.mixing)?)?
    }
}

/// From the bottleneck to one component of the displacement at all inner corners.
struct Decoder {
    first: Convolution,
    second: Enlargement,
    third: Enlargement,
}

impl Decoder {
    fn new(p: &mut Parameters, name: &str, width: usize) -> Result<Self> {
        let [first, second] = DECODER;
        Ok(Self {
            first: Convolution::new(p, &format!("{name}.1"), [width, first], Window(3, 1, 1))?,
            second: Enlargement::new(p, &format!("{name}.2"), [first, second], 1.0)?,
            third: Enlargement::new(p, &format!("{name}.3"), [second, 1], ANSWER_GAIN)?,
        })
    }

    fn forward(&self, features: &Tensor) -> Result<Tensor> {
        self.third.answer(&self.second.forward(&self.first.forward(features)?)?)
    }

    fn export(&self, graph: &mut Graph, features: &Value) -> Result<Value> {
        let y = self.first.export(graph, features)?;
        let y = graph.convolve_transposed(&y, &self.second.weights)?;
        let y = graph.bias_and_activate(&y, &self.second.bias, SLOPE)?;
        let y = graph.convolve_transposed(&y, &self.third.weights)?;
        graph.add_bias(&y, &self.third.bias)
    }
}

/// He's standard deviation for a layer with leaky rectified outputs (He et al., ICCV 2015, eq. 15).
fn he(fan_in: usize) -> f64 {
    (2.0 / ((1.0 + f64::from(SLOPE).powi(2)) * fan_in as f64)).sqrt()
}
