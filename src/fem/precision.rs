//! Numbers that are kept in both precisions: residuals are taken in double, steps in single.

use super::lanes::Real;

/// Numbers in both precisions.
#[derive(Clone, Debug, PartialEq)]
pub struct Both {
    double: Vec<f64>,
    single: Vec<f32>,
}

impl Both {
    /// Of numbers in double precision.
    #[must_use]
    pub fn new(double: Vec<f64>) -> Self {
        let single = double.iter().map(|&value| value as f32).collect();
        Self { double, single }
    }

    /// So many zeros.
    #[must_use]
    pub fn zeros(count: usize) -> Self {
        Self {
            double: vec![0.0; count],
            single: vec![0.0; count],
        }
    }

    /// In both precisions, to be written.
    pub fn parts_mut(&mut self) -> (&mut [f64], &mut [f32]) {
        (&mut self.double, &mut self.single)
    }

    /// In double precision.
    #[must_use]
    pub fn double(&self) -> &[f64] {
        &self.double
    }
}

/// A precision that operators work in.
pub trait Precision: Real {
    /// The numbers in this precision.
    fn of(both: &Both) -> &[Self];
}

impl Precision for f64 {
    fn of(both: &Both) -> &[Self] {
        &both.double
    }
}

impl Precision for f32 {
    fn of(both: &Both) -> &[Self] {
        &both.single
    }
}
