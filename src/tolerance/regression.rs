//! Least squares on functions of the deviations of devices.

use deaflow_linalg::{Mat, eigen};

/// A least squares fit of values by a constant and functions.
pub(crate) struct Fit {
    /// The coefficients of the functions, centred on their means.
    coefficients: Vec<f64>,
    /// The mean of each function.
    means: Vec<f64>,
    /// The mean of the values.
    mean: f64,
    /// The sum of squares that the functions explain.
    pub explained: f64,
    /// The sum of squares of the values about their mean.
    pub total: f64,
}

impl Fit {
    /// Fits `values` by the rows of `functions`; `None` without values.
    pub fn new(functions: &[Vec<f64>], values: &[f64]) -> Option<Self> {
        let count = functions.first()?.len();
        let average = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / functions.len() as f64;
        let mean = average(&mut values.iter().copied());
        let means: Vec<f64> = (0..count)
            .map(|at| average(&mut functions.iter().map(|row| row[at])))
            .collect();
        let mut normal = Mat::zeros(count, count);
        let mut right = vec![0.0; count];
        let mut total = 0.0;
        for (row, value) in functions.iter().zip(values) {
            total += (value - mean) * (value - mean);
            for i in 0..count {
                let own = row[i] - means[i];
                right[i] += own * (value - mean);
                for k in 0..=i {
                    normal[(i, k)] += own * (row[k] - means[k]);
                }
            }
        }
        for i in 0..count {
            for k in 0..i {
                normal[(k, i)] = normal[(i, k)];
            }
        }
        // N⁻¹ r by eigenvectors: functions may depend on each other.
        let found = eigen(&normal)?;
        let (mut coefficients, mut explained) = (vec![0.0; count], 0.0);
        for mode in (0..count).filter(|mode| found.values[*mode] > 0.0) {
            let part: f64 = (0..count).map(|i| found.vectors[(i, mode)] * right[i]).sum();
            explained += part * part / found.values[mode];
            for (i, coefficient) in coefficients.iter_mut().enumerate() {
                *coefficient += found.vectors[(i, mode)] * part / found.values[mode];
            }
        }
        Some(Self {
            coefficients,
            means,
            mean,
            explained,
            total,
        })
    }

    /// Returns the mean of the values if the functions had these means: the values with control variates.
    pub fn mean_at(&self, expected: &[f64]) -> f64 {
        let terms = self.coefficients.iter().zip(&self.means).zip(expected);
        self.mean
            + terms
                .map(|((slope, mean), expected)| slope * (expected - mean))
                .sum::<f64>()
    }
}
