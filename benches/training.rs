//! Where the time of a training goes: the matrix products of the network of the paper, each with the share of the machine's
//! arithmetic bound that it reaches, and a whole training step on one core.
//!
//! `cargo bench --bench training`. The bound is measured: independent fused multiply–adds in the widest registers. Operations of
//! a product are counted as two for each pair of numbers.

use std::cell::Cell;
use std::hint::black_box;
use std::time::Instant;

use deaflow::base::{Stream, thread_seconds};
use deaflow::dataset::Split;
use deaflow::pattern::{Pattern, Raster};
use deaflow::surrogate::{EpochReport, Example, Label, Monitor, OptimizerKind, TrainOptions, train};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use pulp::{Arch, Simd, WithSimd};

/// Name, calls per example in a forward pass, and rows, inner extent and columns of the product.
const PRODUCTS: [(&str, usize, [usize; 3]); 11] = [
    ("encoder.1", 1, [625, 100, 16]),
    ("encoder.2", 1, [169, 784, 32]),
    ("encoder.3", 1, [169, 800, 64]),
    ("encoder.4, 5", 2, [169, 576, 64]),
    ("mixing", 8, [169, 169, 8]),
    ("channels", 1, [169, 64, 64]),
    ("decoder.1", 2, [169, 576, 32]),
    ("decoder.2", 2, [169, 32, 400]),
    ("decoder.3", 2, [625, 16, 25]),
    ("auxiliary.1", 1, [169, 576, 16]),
    ("auxiliary.2", 1, [169, 16, 25]),
];

const EXAMPLES: usize = 256;

fn main() {
    let bound = 1e-9 * Arch::new().dispatch(Peak);
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
    for optimizer in OptimizerKind::ALL {
        let step = pool.install(|| epoch(optimizer)) / EXAMPLES as f64;
        println!(
            "training, {:<6} per example and epoch on one core: {:.2} ms; products are {:.0} % of it",
            optimizer.name(),
            1e3 * step,
            100.0 * products / step
        );
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

/// The least processor time of an epoch, of a few, in s: training on one thread, it is that of the thread, so that it matters
/// little what else the machine does.
fn epoch(optimizer: OptimizerKind) -> f64 {
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
    let options = TrainOptions {
        epochs: 4,
        optimizer,
        ..TrainOptions::default()
    };
    let watch = Watch {
        begun: Cell::new(thread_seconds()),
        least: Cell::new(f64::INFINITY),
    };
    train(&examples, None, &options, &watch).expect("it trains");
    watch.least.get()
}

/// The shortest of many calls, in s.
fn seconds<R>(mut call: impl FnMut() -> R) -> f64 {
    let start = Instant::now();
    let mut best = f64::INFINITY;
    let mut calls = 0;
    while calls < 20 || start.elapsed().as_secs_f64() < 0.1 {
        let start = Instant::now();
        black_box(call());
        best = best.min(start.elapsed().as_secs_f64());
        calls += 1;
    }
    best
}

const ROUNDS: usize = 1 << 18;
/// Independent chains: enough to hide the latency of an operation.
const CHAINS: usize = 12;

struct Peak;

impl WithSimd for Peak {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let (factor, term) = (simd.splat_f32s(black_box(0.5)), simd.splat_f32s(black_box(1.0)));
        let mut sums = [simd.splat_f32s(black_box(0.0)); CHAINS];
        let mut best = f64::INFINITY;
        for _ in 0..20 {
            let start = Instant::now();
            for _ in 0..ROUNDS {
                for sum in &mut sums {
                    *sum = simd.mul_add_e_f32s(*sum, factor, term);
                }
            }
            best = best.min(start.elapsed().as_secs_f64());
        }
        black_box(sums);
        (2 * S::F32_LANES * CHAINS * ROUNDS) as f64 / best
    }
}
