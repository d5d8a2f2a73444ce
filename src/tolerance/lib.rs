//! How many devices reach a displacement, when voltage, material and electrodes differ from one device to the next.
//!
//! Each device is one sample: its deviations are drawn from a scrambled Sobol' sequence, and its scene and pattern are
//! simulated in full.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod device;
mod error;
mod regression;
mod sampling;
mod starts;
mod statistics;
mod study;
#[cfg(test)]
mod tests;
mod wanted;

pub use device::Source;
pub use error::ToleranceError;
pub use sampling::MOST_SAMPLES;
pub use statistics::{Estimate, Quantile, Yield, share_within};
pub use study::{CONVERGED, Device, Failure, Study, check_tolerances};
pub use wanted::Wanted;
