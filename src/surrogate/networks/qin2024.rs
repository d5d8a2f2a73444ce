//! The network of Qin, Ren, Chen, Zou & Gu, "Automatic design framework of dielectric elastomer actuators" (Soft
//! Robotics 2024, doi 10.1089/soro.2024.0063).
//!
//! The paper describes an encoder of five convolutions with large kernels first, a bottleneck, two parallel decoders
//! of three layers for the x and y displacement, and an auxiliary branch for x at half resolution. It gives no widths
//! (its supplement is not public). The widths below were chosen by measurement; a thousand patterns take a second on
//! two cores.
//!
//! The grids of the layers share their points. The first layer has an even kernel, so it maps cells to corners: its 25
//! × 25 outputs lie on the odd corners 1, 3, …, 49, the 13 × 13 outputs of the second layer on 1, 5, …, 49. The
//! decoders apply the transposed maps 13 → 25 → 49, whose outputs are all inner corners. The bottleneck mixes over the
//! whole membrane, because the elastic response is global. Layers that keep grid and width are residual (He et al.,
//! CVPR 2016).
//!
//! Sides of 4k − 2 cells have such grids. Patterns with other sides are padded with zeros (neither bare nor electrode)
//! on the right and above, and outputs beyond their own corners are dropped. Only the matrices of the bottleneck
//! depend on the number of cells.

use candle_core::{Module, Result, Tensor, bail};
use candle_nn::{Conv2dConfig, VarBuilder};

use super::{Network, Output};
use crate::corners::inner_sides;
use crate::layers::{Conv2d, ConvTranspose2d, Mixing};
use crate::onnx::{Export, Graph, Value};
use deaflow_pattern::Raster;

/// Channels after the first and second layer of the encoder, and from the third on.
const ENCODER: [usize; 3] = [16, 32, 64];
/// Channels after the first and second layer of a decoder. The third is the output.
const DECODER: [usize; 2] = [32, 16];
/// Channels of the auxiliary branch.
const AUXILIARY: usize = 16;
/// Largest number of entries of the matrices in the bottleneck, 256 MiB: 200 × 200 cells.
const MAX_ENTRIES: usize = 1 << 26;
/// Groups of channels in the bottleneck. Each has its own mixing matrix.
const GROUPS: usize = 8;
/// Kernel side of the upsampling and output layers.
const UPSAMPLE: usize = 5;
/// Slope of the activation below zero. The usual 0.01 to 0.2 are worse, because the elastic response is nearly linear
/// in the pattern: with a thousand examples and eight epochs, slopes of 0.1, 0.4 and 0.7 gave errors of 0.035, 0.029
/// and 0.026 mm.
const SLOPE: f32 = 0.7;
/// Gain of the initial weights of the output layers. Small weights start training near the mean output, zero.
const OUTPUT_GAIN: f64 = 0.3;

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
    /// Checks that the network can have patterns of these cells.
    pub(super) fn check(raster: Raster) -> Result<()> {
        Grid::new(raster).map(|_| ())
    }

    /// Builds the network for patterns of these cells from the given weights.
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
                output([AUXILIARY, 1], &weights.pp("auxiliary.2"))?,
            ),
        })
    }

    /// Computes the input of the decoders and the auxiliary branch.
    fn features(&self, patterns: &Tensor) -> Result<Tensor> {
        let [first, second, third, fourth, fifth] = &self.encoder;
        let features = self.grid.pad(patterns)?;
        let features = features.apply(first)?.apply(second)?.apply(third)?;
        let features = (&features + features.apply(fourth)?)?;
        let features = (&features + features.apply(fifth)?)?;
        features.apply(&self.bottleneck)
    }

    fn decode(&self, features: &Tensor) -> Result<Tensor> {
        let both = Tensor::cat(&[features.apply(&self.x)?, features.apply(&self.y)?], 3)?;
        self.grid.crop(&both, 1)
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
            half_resolution: Some(self.grid.crop(&features.apply(first)?.apply(second)?, 2)?),
        })
    }
}

impl Export for Qin2024 {
    fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let [first, second, third, fourth, fifth] = &self.encoder;
        let features = match self.grid.padding() {
            [0, 0] => patterns.clone(),
            [right, above] => graph.pad(patterns, &[0, 0, 0, 0, 0, above as i64, right as i64, 0]),
        };
        let features = first.export(graph, &features)?;
        let features = second.export(graph, &features)?;
        let mut features = third.export(graph, &features)?;
        for layer in [fourth, fifth] {
            let residual = layer.export(graph, &features)?;
            features = graph.add(&features, &residual);
        }
        let features = self.bottleneck.export(graph, &features)?;
        let (x, y) = (self.x.export(graph, &features)?, self.y.export(graph, &features)?);
        let both = graph.concatenate(&[&x, &y], 3);
        let [columns, rows] = inner_sides(self.grid.raster);
        Ok(match self.grid.padding() {
            [0, 0] => both,
            _ => graph.first(&both, [rows, columns]),
        })
    }
}

/// The grids of a network.
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
        let entries = GROUPS * (coarse[0] * coarse[1]).pow(2);
        if entries > MAX_ENTRIES {
            bail!(
                "network qin2024 for {raster} cells has matrices of {entries} entries, but at most {MAX_ENTRIES} are \
                 allowed; use fewer cells, about 200 × 200"
            );
        }
        Ok(Self { raster, coarse })
    }

    /// Returns the numbers of cells that are added on the right and above.
    fn padding(self) -> [usize; 2] {
        [0, 1].map(|axis| 4 * self.coarse[axis] - 2 - self.raster.sides()[axis])
    }

    /// Pads patterns with zeros to the size of the grids.
    fn pad(self, patterns: &Tensor) -> Result<Tensor> {
        let [right, above] = self.padding();
        let padded = patterns.pad_with_zeros(1, 0, above)?.pad_with_zeros(2, 0, right)?;
        padded.contiguous()
    }

    /// Drops outputs beyond the corners of the membrane. `step` is the distance of the outputs in corners.
    fn crop(self, output: &Tensor, step: usize) -> Result<Tensor> {
        let [columns, rows] = inner_sides(self.raster).map(|side| side.div_ceil(step));
        output.narrow(1, 0, rows)?.narrow(2, 0, columns)?.contiguous()
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

/// An upsampling layer: maps a grid of n × n points to (2n − 1) × (2n − 1).
fn upsampling(channels: [usize; 2], weights: &VarBuilder<'_>) -> Result<ConvTranspose2d> {
    ConvTranspose2d::new(
        channels,
        UPSAMPLE,
        he(upsampling_fan_in(channels)),
        Some(SLOPE),
        weights,
    )
}

/// The output layer of a branch: an upsampling layer without activation.
fn output(channels: [usize; 2], weights: &VarBuilder<'_>) -> Result<ConvTranspose2d> {
    let stdev = OUTPUT_GAIN * he(upsampling_fan_in(channels));
    ConvTranspose2d::new(channels, UPSAMPLE, stdev, None, weights)
}

/// Returns the number of inputs of an output of an upsampling layer. A quarter of the window falls on inputs.
fn upsampling_fan_in([from, _]: [usize; 2]) -> usize {
    from * UPSAMPLE * UPSAMPLE / 4
}

/// Returns He's standard deviation for a layer with leaky rectified outputs (He et al., ICCV 2015, eq. 15).
fn he(fan_in: usize) -> f64 {
    (2.0 / ((1.0 + f64::from(SLOPE).powi(2)) * fan_in as f64)).sqrt()
}

/// A residual layer that mixes each channel over the whole grid, then the channels at each point.
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
        let residual = self.channels.export(graph, &mixed)?;
        Ok(graph.add(x, &residual))
    }
}

/// Maps the bottleneck to one component of the displacement at all inner corners.
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
            second: upsampling([first, second], &weights.pp("2"))?,
            third: output([second, 1], &weights.pp("3"))?,
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
    use crate::parameters::RandomWeights;

    #[test]
    fn any_raster_has_outputs_at_all_inner_corners() {
        let constants = BTreeMap::new();
        for (columns, rows) in [(40, 24), (6, 10), (7, 3), (2, 9)] {
            let raster = Raster::new(columns, rows).unwrap();
            let weights = RandomWeights::new(&constants, 1);
            let network = Qin2024::new(&weights.builder(), raster).unwrap();
            let patterns = Tensor::zeros((2, rows, columns, 1), DType::F32, &Device::Cpu).unwrap();
            let output = network.forward_for_training(&patterns, None).unwrap();
            assert_eq!(output.displacement.dims(), [2, rows - 1, columns - 1, 2]);
            let half = output.half_resolution.unwrap();
            assert_eq!(half.dims(), [2, rows / 2, columns / 2, 1]);
        }
    }

    #[test]
    fn unsupported_rasters_are_refused() {
        let constants = BTreeMap::new();
        for (sides, expected) in [((1, 9), "nothing moves"), ((400, 400), "fewer cells")] {
            let raster = Raster::new(sides.0, sides.1).unwrap();
            let error = Qin2024::new(&RandomWeights::new(&constants, 1).builder(), raster)
                .err()
                .unwrap();
            assert!(error.to_string().contains(expected), "{error}");
        }
    }
}
