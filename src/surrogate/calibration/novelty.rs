//! The novelty of a pattern: its distance from familiar patterns.

use deaflow_linalg::{Mat, cholesky, solve_lower};

use super::difficulty::rank;
use super::error::CalibrationError;

/// Number of neighbours in mean distances.
const NEIGHBOURS: usize = 8;

/// Added to the variances of the scaled features, so that features that hardly vary are not amplified.
const SOFTENING: f64 = 0.02;

/// The arrays in files.
#[derive(Clone, Debug, PartialEq)]
pub struct NoveltyParts {
    /// Mean of each feature.
    pub centre: Vec<f64>,
    /// Standard deviation of each feature.
    pub deviation: Vec<f64>,
    /// Lower Cholesky factor of the covariance of the scaled features, row by row.
    pub factor: Vec<f64>,
    /// Whitened features of the familiar patterns, concatenated.
    pub points: Vec<f64>,
    /// Mean distance of each familiar pattern from its neighbours.
    pub distances: Vec<f64>,
    /// Ratio above which a pattern is out of distribution.
    pub threshold: f64,
}

/// The familiar patterns.
pub(super) struct Novelty {
    parts: NoveltyParts,
    factor: Mat<f64>,
}

impl Novelty {
    /// Fits the features of familiar patterns. One half are the neighbours; the other half determines the threshold,
    /// which a share of `false_alarm` exceeds.
    ///
    /// # Errors
    /// When a feature is not a number.
    pub(super) fn fit(familiar: &[&[f64]], false_alarm: f64) -> Result<Self, CalibrationError> {
        let (reference, fresh) = familiar.split_at(familiar.len() / 2);
        let (n, m) = (reference.len() as f64, reference[0].len());
        let mean = |k: usize| reference.iter().map(|f| f[k]).sum::<f64>() / n;
        let centre: Vec<f64> = (0..m).map(mean).collect();
        let variance = |k: usize| reference.iter().map(|f| (f[k] - centre[k]).powi(2)).sum::<f64>() / n;
        let deviation: Vec<f64> = (0..m).map(|k| variance(k).sqrt() + 1e-6).collect();
        let scaled: Vec<Vec<f64>> = reference.iter().map(|f| scaled(f, &centre, &deviation)).collect();
        let covariance = Mat::from_fn(m, m, |i, j| {
            let products: f64 = scaled.iter().map(|row| row[i] * row[j]).sum();
            products / n + if i == j { SOFTENING } else { 0.0 }
        });
        let factor = cholesky(&covariance).ok_or(CalibrationError::Singular)?;
        let points: Vec<f64> = scaled.iter().flat_map(|row| whitened(&factor, row)).collect();
        let distance = |i: usize| mean_distance(&nearest(&points[i * m..][..m], &points, Some(i)));
        let distances = (0..reference.len()).map(distance).collect();
        let mut fitted = Self {
            parts: NoveltyParts {
                centre,
                deviation,
                factor: (0..m * m).map(|at| factor[(at / m, at % m)]).collect(),
                points,
                distances,
                threshold: 1.0,
            },
            factor,
        };
        let mut ratios: Vec<f64> = fresh.iter().map(|features| fitted.novelty(features)).collect();
        ratios.sort_by(f64::total_cmp);
        fitted.parts.threshold = ratios[rank(ratios.len(), 1.0 - false_alarm)].max(f64::MIN_POSITIVE);
        Ok(fitted)
    }

    /// Returns the mean distance of a pattern from its neighbours, relative to their own distances and the threshold.
    pub(super) fn novelty(&self, features: &[f64]) -> f64 {
        let parts = &self.parts;
        let point = whitened(&self.factor, &scaled(features, &parts.centre, &parts.deviation));
        let nearest = nearest(&point, &parts.points, None);
        let own = nearest.iter().map(|&(_, i)| parts.distances[i]).sum::<f64>() / nearest.len() as f64;
        let mean = parts.distances.iter().sum::<f64>() / parts.distances.len() as f64;
        // Distances of coinciding familiar patterns vanish, so a small part of the mean is added.
        mean_distance(&nearest) / (own + 0.05 * mean + 1e-12) / parts.threshold
    }

    /// Returns the arrays.
    pub(super) fn parts(&self) -> NoveltyParts {
        self.parts.clone()
    }

    /// Checks the arrays.
    pub(super) fn from_parts(parts: NoveltyParts) -> Result<Self, CalibrationError> {
        let m = parts.centre.len();
        let fits = m > 0
            && parts.deviation.len() == m
            && parts.factor.len() == m * m
            && !parts.distances.is_empty()
            && parts.points.len() == m * parts.distances.len()
            && parts.threshold > 0.0;
        if !fits {
            return Err(CalibrationError::Parts("novelty"));
        }
        let factor = Mat::from_fn(m, m, |i, j| parts.factor[i * m + j]);
        Ok(Self { parts, factor })
    }
}

/// Returns L⁻¹ v: uncorrelated features of variance 1.
fn whitened(factor: &Mat<f64>, v: &[f64]) -> Vec<f64> {
    let mut solved = v.to_vec();
    solve_lower(factor, &mut solved);
    solved
}

fn scaled(features: &[f64], centre: &[f64], deviation: &[f64]) -> Vec<f64> {
    let each = features.iter().zip(centre).zip(deviation);
    each.map(|((f, c), d)| (f - c) / d).collect()
}

/// Returns distances and indices of the points nearest to a point, without the point `own` itself.
fn nearest(point: &[f64], points: &[f64], own: Option<usize>) -> Vec<(f64, usize)> {
    let squares = |other: &[f64]| other.iter().zip(point).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let distances = points.chunks_exact(point.len()).map(|other| squares(other).sqrt());
    let mut found: Vec<(f64, usize)> = distances.zip(0..).collect();
    if let Some(own) = own {
        found.swap_remove(own);
    }
    let count = NEIGHBOURS.min(found.len());
    let order = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if count > 0 {
        found.select_nth_unstable_by(count - 1, order);
    }
    found.truncate(count);
    found.sort_by(order);
    found
}

fn mean_distance(nearest: &[(f64, usize)]) -> f64 {
    nearest.iter().map(|(distance, _)| distance).sum::<f64>() / nearest.len() as f64
}
