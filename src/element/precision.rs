//! Numbers stored in both precisions: residuals are computed in double, steps in single precision.

use super::lanes::Real;

/// Numbers in both precisions.
#[derive(Clone, Debug, PartialEq)]
pub struct BothPrecisions {
    double: Vec<f64>,
    single: Vec<f32>,
}

impl BothPrecisions {
    /// Converts numbers in double precision.
    #[must_use]
    pub fn new(double: Vec<f64>) -> Self {
        let single = double.iter().map(|&value| value as f32).collect();
        Self { double, single }
    }

    /// Creates a number of zeros.
    #[must_use]
    pub fn zeros(count: usize) -> Self {
        Self {
            double: vec![0.0; count],
            single: vec![0.0; count],
        }
    }

    /// Returns the numbers in both precisions, writable.
    pub fn parts_mut(&mut self) -> (&mut [f64], &mut [f32]) {
        (&mut self.double, &mut self.single)
    }

    /// Returns the numbers in double precision.
    #[must_use]
    pub fn double(&self) -> &[f64] {
        &self.double
    }
}

/// A precision of operators.
pub trait Precision: Real {
    /// Returns the numbers in this precision.
    fn of(both: &BothPrecisions) -> &[Self];
}

impl Precision for f64 {
    fn of(both: &BothPrecisions) -> &[Self] {
        &both.double
    }
}

impl Precision for f32 {
    fn of(both: &BothPrecisions) -> &[Self] {
        &both.single
    }
}
