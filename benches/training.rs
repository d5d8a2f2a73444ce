//! Where the time of a training goes: the matrix products of the network of the paper, each with the share of the
//! machine's arithmetic bound that it reaches, and a whole training step on one core.
//!
//! `RAYON_NUM_THREADS=1 cargo bench --bench training`. The bound is measured: independent fused multiply–adds in the
//! widest registers. Operations of a product are counted as two for each pair of numbers. Beside it stands the same
//! network in candle's own layers, which would take more threads without that variable; `benches/peers/training.py` is
//! the same in PyTorch.

mod bound;
#[allow(dead_code, reason = "predictions are in another benchmark")]
mod network_work;

use std::cell::Cell;

use bound::{arithmetic32, row, seconds};
use deaflow::base::{Stream, thread_seconds};
use deaflow::dataset::Split;
use deaflow::fem::LinearResponse;
use deaflow::field::Mesh;
use deaflow::pattern::{Pattern, Raster};
use deaflow::scene::Scene;
use deaflow::surrogate::{
    Constants, EpochReport, Example, Label, Monitor, NetworkKind, OptimizerKind, TrainOptions, train,
};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use network_work::PRODUCTS;

const EXAMPLES: usize = 256;

fn main() {
    let bound = 1e-9 * arithmetic32();
    println!("arithmetic bound of one core: {bound:.0} Gflop/s in f32\n");
    println!("product        rows inner cols   value  of bound   by weights  of bound   by input  of bound");
    let mut products = 0.0;
    for (name, calls, shape) in PRODUCTS {
        let kinds = [Kind::Value, Kind::ByWeights, Kind::ByInput].map(|kind| kind.seconds(shape));
        // The patterns themselves need no gradient.
        let needed = if name == "encoder.1" { 2 } else { 3 };
        products += calls as f64 * kinds[..needed].iter().sum::<f64>();
        let flops = 2e-9 * shape.iter().product::<usize>() as f64;
        let columns = kinds.map(|seconds| {
            let rate = flops / seconds;
            format!("{rate:>6.1} {:>7.0} %", 100.0 * rate / bound)
        });
        let [m, k, n] = shape;
        println!("{name:<13} {m:>5} {k:>5} {n:>4}  {}", columns.join("    "));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.expect("a thread can be started");
    println!(
        "\nproducts of one example, value and gradients: {:.2} ms",
        1e3 * products
    );
    let mut rows = Vec::new();
    for optimizer in OptimizerKind::ALL {
        let step = pool.install(|| epoch(optimizer)) / EXAMPLES as f64;
        println!(
            "training, {:<6} per example and epoch on one core: {:.2} ms; products are {:.0} % of it",
            optimizer.name(),
            1e3 * step,
            100.0 * products / step
        );
        rows.push(row(
            &format!("training qin2024, {}", optimizer.name()),
            step,
            network_work::train_qin2024(),
        ));
    }
    let step = pool.install(physics_epoch) / EXAMPLES as f64;
    rows.push(row("training physics, adamw", step, network_work::train_physics()));
    bound::print(&rows);
    println!();
    if candle_core::utils::get_num_threads() > 1 {
        println!("candle's own layers are left out: they would take more than one core (RAYON_NUM_THREADS=1)");
        return;
    }
    let step = pool.install(plain::epoch).expect("it trains") / EXAMPLES as f64;
    println!("candle's own layers, AdamW, the same: {:.2} ms", 1e3 * step);
}

/// The same network in candle's own layers, as one would write it first.
mod plain {
    use candle_core::{DType, Device, Result, Tensor};
    use candle_nn::loss::huber;
    use candle_nn::ops::leaky_relu;
    use candle_nn::{
        AdamW, Conv2d, Conv2dConfig, ConvTranspose2d, ConvTranspose2dConfig, Init, Module, Optimizer, ParamsAdamW,
        VarBuilder, VarMap, conv_transpose2d, conv2d,
    };
    use deaflow::base::thread_seconds;

    use super::EXAMPLES;

    const BATCH: usize = 8;
    const SLOPE: f64 = 0.7;
    const GROUPS: usize = 8;
    const COARSE: usize = 13;

    struct Network {
        encoder: Vec<Conv2d>,
        mixing: Tensor,
        channels: Conv2d,
        decoders: [(Conv2d, [ConvTranspose2d; 2]); 2],
        auxiliary: (Conv2d, ConvTranspose2d),
    }

    fn layer(from: usize, to: usize, window: [usize; 3], weights: VarBuilder<'_>) -> Result<Conv2d> {
        let [side, stride, padding] = window;
        let config = Conv2dConfig {
            stride,
            padding,
            ..Conv2dConfig::default()
        };
        conv2d(from, to, side, config, weights)
    }

    fn enlarged(from: usize, to: usize, weights: VarBuilder<'_>) -> Result<ConvTranspose2d> {
        let config = ConvTranspose2dConfig {
            stride: 2,
            padding: 2,
            ..ConvTranspose2dConfig::default()
        };
        conv_transpose2d(from, to, 5, config, weights)
    }

    impl Network {
        fn new(weights: &VarBuilder<'_>) -> Result<Self> {
            let windows = [[10, 2, 4], [7, 2, 3], [5, 1, 2], [3, 1, 1], [3, 1, 1]];
            let widths = [1, 16, 32, 64, 64, 64];
            let encoder =
                (0..5).map(|i| layer(widths[i], widths[i + 1], windows[i], weights.pp(format!("encoder.{i}"))));
            let decoder = |name: &str| {
                let weights = weights.pp(name);
                let last = [enlarged(32, 16, weights.pp(1))?, enlarged(16, 1, weights.pp(2))?];
                Ok::<_, candle_core::Error>((layer(64, 32, [3, 1, 1], weights.pp(0))?, last))
            };
            let init = Init::Randn {
                mean: 0.0,
                stdev: 1.0 / COARSE as f64,
            };
            let positions = COARSE * COARSE;
            Ok(Self {
                encoder: encoder.collect::<Result<_>>()?,
                mixing: weights.get_with_hints((GROUPS, positions, positions), "mixing", init)?,
                channels: layer(64, 64, [1, 1, 0], weights.pp("channels"))?,
                decoders: [decoder("x")?, decoder("y")?],
                auxiliary: (
                    layer(64, 16, [3, 1, 1], weights.pp("auxiliary.0"))?,
                    enlarged(16, 1, weights.pp("auxiliary.1"))?,
                ),
            })
        }

        fn forward(&self, patterns: &Tensor) -> Result<[Tensor; 2]> {
            let activated = |layer: &Conv2d, x: &Tensor| leaky_relu(&layer.forward(x)?, SLOPE);
            let mut x = patterns.clone();
            for (i, layer) in self.encoder.iter().enumerate() {
                let y = activated(layer, &x)?;
                x = if i < 3 { y } else { (x + y)? };
            }
            let n = x.dim(0)?;
            let grouped = x.reshape((n, GROUPS, 64 / GROUPS, COARSE * COARSE))?;
            let mixed = grouped.broadcast_matmul(&self.mixing.transpose(1, 2)?.contiguous()?)?;
            let mixed = mixed.reshape(x.shape())?;
            let x = (&x + activated(&self.channels, &mixed)?)?;
            let decoded = |(first, [second, third]): &(Conv2d, [ConvTranspose2d; 2])| {
                let y = leaky_relu(&second.forward(&activated(first, &x)?)?, SLOPE)?;
                third.forward(&y)
            };
            let field = Tensor::cat(&[decoded(&self.decoders[0])?, decoded(&self.decoders[1])?], 1)?;
            let (first, second) = &self.auxiliary;
            Ok([field, second.forward(&activated(first, &x)?)?])
        }
    }

    fn loss(network: &Network, patterns: &Tensor, targets: &Tensor, half: &Tensor) -> Result<Tensor> {
        let [field, auxiliary] = network.forward(patterns)?;
        let largest = (&field - targets)?.abs()?.flatten_from(1)?.max(1)?.mean_all()?;
        let loss = (huber(&field, targets, 1.0)? + (largest * 0.1)?)?;
        loss + (huber(&auxiliary, half, 1.0)? * 0.2)?
    }

    /// The least processor time of an epoch of some, in s.
    pub fn epoch() -> Result<f64> {
        let (map, device) = (VarMap::new(), Device::Cpu);
        let network = Network::new(&VarBuilder::from_varmap(&map, DType::F32, &device))?;
        let parameters = ParamsAdamW {
            lr: 2e-3,
            weight_decay: 1e-4,
            ..ParamsAdamW::default()
        };
        let mut optimizer = AdamW::new(map.all_vars(), parameters)?;
        let patterns = Tensor::rand(-0.5f32, 0.5, (BATCH, 1, 50, 50), &device)?;
        let targets = Tensor::zeros((BATCH, 2, 49, 49), DType::F32, &device)?;
        let half = Tensor::zeros((BATCH, 1, 25, 25), DType::F32, &device)?;
        let mut least = f64::INFINITY;
        for _ in 0..2 {
            let begun = thread_seconds();
            for _ in 0..EXAMPLES / BATCH {
                optimizer.backward_step(&loss(&network, &patterns, &targets, &half)?)?;
            }
            least = least.min(thread_seconds() - begun);
        }
        Ok(least)
    }
}

/// Which of the three products of a layer.
#[derive(Clone, Copy)]
enum Kind {
    /// out = x · Wᵀ.
    Value,
    /// dW = doutᵀ · x.
    ByWeights,
    /// dx = dout · W.
    ByInput,
}

impl Kind {
    /// What one takes, for x of `m` rows and `k` columns and `n` outputs.
    fn seconds(self, [m, k, n]: [usize; 3]) -> f64 {
        let numbers = |count: usize| vec![0.5f32; count];
        let (x, w, out) = (numbers(m * k), numbers(n * k), numbers(m * n));
        let row_major = |values, columns| {
            let values: &Vec<f32> = values;
            MatRef::from_row_major_slice(values, values.len() / columns, columns)
        };
        let (x, w, out) = (row_major(&x, k), row_major(&w, k), row_major(&out, n));
        let (left, right) = match self {
            Self::Value => (x, w.transpose()),
            Self::ByWeights => (out.transpose(), x),
            Self::ByInput => (out, w),
        };
        let columns = right.ncols();
        let mut target = numbers(left.nrows() * columns);
        seconds(|| {
            let target = MatMut::from_row_major_slice_mut(&mut target, left.nrows(), columns);
            matmul(target, Accum::Replace, left, right, 1.0, Par::Seq);
        })
    }
}

/// The least processor time of an epoch, of a few, in s: training on one thread, it is that of the thread, so that it
/// matters little what else the machine does.
fn epoch(optimizer: OptimizerKind) -> f64 {
    let options = TrainOptions {
        epochs: 4,
        optimizer,
        ..TrainOptions::default()
    };
    least_of(&options, None)
}

/// The same of `physics`.
fn physics_epoch() -> f64 {
    let scene = Scene::vhb4910();
    let response = LinearResponse::new(&scene, Mesh::biquadratic(1)).expect("the membrane is stable");
    let constants = Constants::new(&response, &scene).expect("the membrane moves");
    let options = TrainOptions {
        network: NetworkKind::Physics,
        epochs: 4,
        optimizer: OptimizerKind::AdamW,
        learning_rate: 0.01,
        batch: 16,
        ..TrainOptions::default()
    };
    least_of(&options, Some(&constants))
}

fn least_of(options: &TrainOptions, constants: Option<&Constants>) -> f64 {
    struct Watch {
        begun: Cell<f64>,
        least: Cell<f64>,
    }
    impl Monitor for Watch {
        fn step(&self, _: u32, done: f64, _: f64) {
            if done == 1.0 {
                self.least
                    .set(self.least.get().min(thread_seconds() - self.begun.get()));
            }
        }

        fn epoch(&self, _: &EpochReport) {
            self.begun.set(thread_seconds());
        }
    }
    let example = |k: u64| {
        let mut stream = Stream::new(1, "training bench", k);
        let on = stream.choose(25, 12);
        Example {
            pattern: Pattern::from_fn(Raster::PAPER, |x, y| on.contains(&(x / 10 + y / 10 * 5))),
            label: Label::zero(Raster::PAPER),
            family: "grid".to_owned(),
            split: if k < EXAMPLES as u64 {
                Split::Train
            } else {
                Split::Validation
            },
            repeats: 1,
        }
    };
    let examples: Vec<Example> = (0..EXAMPLES as u64 + 1).map(example).collect();
    let watch = Watch {
        begun: Cell::new(thread_seconds()),
        least: Cell::new(f64::INFINITY),
    };
    train(&examples, constants, options, &watch).expect("it trains");
    watch.least.get()
}
