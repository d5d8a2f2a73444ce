//! The deviations of each device.

use deaflow_base::Stream;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::device::SOURCES;

/// Largest number of samples: the length of the sequence.
pub const MOST_SAMPLES: u32 = 65536;

/// Half the distance between two points of the sequence along an axis, which has 24 bits.
const HALF: f64 = 0.5 / (1 << 24) as f64;

/// Returns the standard normal deviations of a device: an Owen-scrambled Sobol' sequence, mapped by the inverse of the
/// normal distribution.
pub(crate) fn deviations(seed: u64, index: u32) -> [f64; SOURCES] {
    // The scrambling takes 32 bits of a seed.
    let scramble = Stream::new(seed, "deviations of devices", 0).next_u64() as u32;
    let normal = Normal::standard();
    std::array::from_fn(|axis| {
        let point = f64::from(sobol_burley::sample(index, axis as u32, scramble)) + HALF;
        normal.inverse_cdf(point)
    })
}

/// Returns which of some cells are lost, each with the same probability.
pub(crate) fn lost(seed: u64, index: u32, cells: usize, probability: f64) -> Vec<bool> {
    let mut stream = Stream::new(seed, "lost cells of devices", u64::from(index));
    (0..cells).map(|_| stream.chance(probability)).collect()
}
