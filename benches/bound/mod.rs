//! What one core of the machine can do at the most, measured: what the other benchmarks are held against.

use std::hint::black_box;
use std::sync::LazyLock;
use std::time::Instant;

use pulp::{Arch, Simd, WithSimd};

const ROUNDS: usize = 1 << 18;
/// Independent chains: enough to hide the latency of an operation.
const CHAINS: usize = 12;

/// Operations in double precision a second: independent fused multiply–adds in the widest registers.
pub fn arithmetic64() -> f64 {
    static PEAK: LazyLock<f64> = LazyLock::new(|| Arch::new().dispatch(Peak64));
    *PEAK
}

/// The same in single precision.
pub fn arithmetic32() -> f64 {
    static PEAK: LazyLock<f64> = LazyLock::new(|| Arch::new().dispatch(Peak32));
    *PEAK
}

/// Bytes a second that are read and written by `y += a x` where both arrays together take so many bytes: what lies in a
/// cache that holds them is as fast as that cache.
pub fn memory(bytes: usize) -> f64 {
    let count = (bytes / 8).max(1024);
    let (x, mut y) = (vec![1.0f32; count], vec![1.0f32; count]);
    let a = black_box(1e-9f32);
    let rounds = ((64 << 20) / bytes.max(1)).max(1);
    let seconds = seconds(|| {
        for _ in 0..rounds {
            Arch::new().dispatch(|| y.iter_mut().zip(&x).for_each(|(y, x)| *y += a * x));
            black_box(&mut y);
        }
    });
    (12 * count * rounds) as f64 / seconds
}

/// The shortest of many calls, in s.
pub fn seconds<R>(mut call: impl FnMut() -> R) -> f64 {
    let start = Instant::now();
    let mut best = f64::INFINITY;
    let mut calls = 0;
    while calls < 20 || start.elapsed().as_secs_f64() < 0.3 {
        let start = Instant::now();
        black_box(call());
        best = best.min(start.elapsed().as_secs_f64());
        calls += 1;
    }
    best
}

/// Work whose operations and bytes are known.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// Operations in double precision; a fused multiply–add counts as two.
    pub double: f64,
    /// The same in single precision.
    pub single: f64,
    /// Bytes that are read and written.
    pub bytes: f64,
    /// Bytes of all arrays that these go to and fro, over and over.
    pub held: usize,
}

/// Prints the table of these [`row`]s.
pub fn print(rows: &[String]) {
    println!("\nwork                                 ms  arithmetic  memory  waiting and all else");
    rows.iter().for_each(|row| println!("{row}"));
}

/// What share of some seconds the bounds account for. Both go on at once, so what is left beside the larger is waiting
/// for what was asked before, operations that are not counted, and calls.
pub fn row(name: &str, seconds: f64, work: Work) -> String {
    let arithmetic = (work.double / arithmetic64() + work.single / arithmetic32()) / seconds;
    let memory = work.bytes / memory(work.held) / seconds;
    format!(
        "{name:<31}{:>8.3}  {:>8.0} %  {:>4.0} %  {:>18.0} %",
        1e3 * seconds,
        100.0 * arithmetic,
        100.0 * memory,
        100.0 * (1.0 - arithmetic.max(memory))
    )
}

/// The operations a second of a precision, as the type that measures them.
macro_rules! peak {
    ($name:ident, $lanes:ident, $splat:ident, $mul_add:ident) => {
        struct $name;

        impl WithSimd for $name {
            type Output = f64;

            #[inline(always)]
            fn with_simd<S: Simd>(self, simd: S) -> f64 {
                let (factor, term) = (simd.$splat(black_box(0.5)), simd.$splat(black_box(1.0)));
                let mut sums = [simd.$splat(black_box(0.0)); CHAINS];
                let mut best = f64::INFINITY;
                for _ in 0..20 {
                    let start = Instant::now();
                    for _ in 0..ROUNDS {
                        for sum in &mut sums {
                            *sum = simd.$mul_add(*sum, factor, term);
                        }
                    }
                    best = best.min(start.elapsed().as_secs_f64());
                }
                black_box(sums);
                (2 * S::$lanes * CHAINS * ROUNDS) as f64 / best
            }
        }
    };
}

peak!(Peak64, F64_LANES, splat_f64s, mul_add_e_f64s);
peak!(Peak32, F32_LANES, splat_f32s, mul_add_e_f32s);
