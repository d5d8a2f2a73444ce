//! How far a pattern is from those that are familiar: its novelty.

use deaflow_linalg::{Mat, cholesky, solve_lower};

use super::CalibrationError;
use super::difficulty::rank;

/// Neighbours whose mean distance counts.
const NEIGHBOURS: usize = 8;

/// Added to the variances of the scaled features: what hardly varies among familiar patterns is not blown up.
const SOFTENING: f64 = 0.02;

/// The arrays, as they stand in files.
#[derive(Clone, Debug, PartialEq)]
pub struct NoveltyParts {
    /// Mean of each feature, which is taken off.
    pub centre: Vec<f64>,
    /// Deviation of each feature, by which it is then divided.
    pub deviation: Vec<f64>,
    /// Lower Cholesky factor of the covariance of the scaled features, row by row.
    pub factor: Vec<f64>,
    /// Uncorrelated coordinates of the familiar patterns, end to end.
    pub places: Vec<f64>,
    /// Mean distance of each to its nearest.
    pub spreads: Vec<f64>,
    /// Ratio above which a pattern is out of distribution.
    pub threshold: f64,
}

pub(super) struct Novelty {
    centre: Vec<f64>,
    deviation: Vec<f64>,
    /// Lower Cholesky factor of the covariance of the scaled features: its inverse makes them uncorrelated, of variance 1.
    factor: Mat<f64>,
    places: Vec<Vec<f64>>,
    spreads: Vec<f64>,
    threshold: f64,
}

impl Novelty {
    /// From the features of familiar patterns: half of them are the neighbours, and of the other half all but a share of
    /// `false_alarm` are to stay below the threshold.
    ///
    /// # Errors
    /// When a feature is no number.
    pub(super) fn fit(familiar: &[&[f64]], false_alarm: f64) -> Result<Self, CalibrationError> {
        let (reference, fresh) = familiar.split_at(familiar.len() / 2);
        let (n, m) = (reference.len() as f64, reference[0].len());
        let centre: Vec<f64> = (0..m)
            .map(|k| reference.iter().map(|f| f[k]).sum::<f64>() / n)
            .collect();
        let variance = |k: usize| reference.iter().map(|f| (f[k] - centre[k]).powi(2)).sum::<f64>() / n;
        let deviation: Vec<f64> = (0..m).map(|k| variance(k).sqrt() + 1e-6).collect();
        let scaled: Vec<Vec<f64>> = reference.iter().map(|f| scaled(f, &centre, &deviation)).collect();
        let covariance = Mat::from_fn(m, m, |i, j| {
            let products: f64 = scaled.iter().map(|row| row[i] * row[j]).sum();
            products / n + if i == j { SOFTENING } else { 0.0 }
        });
        let factor = cholesky(&covariance).ok_or(CalibrationError::Singular)?;
        let places: Vec<Vec<f64>> = scaled.iter().map(|row| whitened(&factor, row)).collect();
        let spreads = (0..places.len())
            .map(|i| mean_distance(&nearest(&places[i], &places, Some(i))))
            .collect();
        let mut fitted = Self {
            centre,
            deviation,
            factor,
            places,
            spreads,
            threshold: 1.0,
        };
        let mut ratios: Vec<f64> = fresh.iter().map(|features| fitted.novelty(features)).collect();
        ratios.sort_by(f64::total_cmp);
        fitted.threshold = ratios[rank(ratios.len(), 1.0 - false_alarm)].max(f64::MIN_POSITIVE);
        Ok(fitted)
    }

    /// The distance of a pattern to its nearest familiar ones, in units of their own, relative to the threshold.
    pub(super) fn novelty(&self, features: &[f64]) -> f64 {
        let place = whitened(&self.factor, &scaled(features, &self.centre, &self.deviation));
        let nearest = nearest(&place, &self.places, None);
        let own = nearest.iter().map(|&(_, i)| self.spreads[i]).sum::<f64>() / nearest.len() as f64;
        let usual = self.spreads.iter().sum::<f64>() / self.spreads.len() as f64;
        // Where familiar patterns coincide their distances vanish; a small part of the usual one is added.
        mean_distance(&nearest) / (own + 0.05 * usual + 1e-12) / self.threshold
    }

    /// The arrays.
    pub(super) fn parts(&self) -> NoveltyParts {
        let m = self.centre.len();
        NoveltyParts {
            centre: self.centre.clone(),
            deviation: self.deviation.clone(),
            factor: (0..m * m).map(|at| self.factor[(at / m, at % m)]).collect(),
            places: self.places.concat(),
            spreads: self.spreads.clone(),
            threshold: self.threshold,
        }
    }

    pub(super) fn from_parts(parts: NoveltyParts) -> Result<Self, CalibrationError> {
        let m = parts.centre.len();
        let fits = m > 0
            && parts.deviation.len() == m
            && parts.factor.len() == m * m
            && !parts.spreads.is_empty()
            && parts.places.len() == m * parts.spreads.len()
            && parts.threshold > 0.0;
        if !fits {
            return Err(CalibrationError::Parts("likeness"));
        }
        Ok(Self {
            factor: Mat::from_fn(m, m, |i, j| parts.factor[i * m + j]),
            places: parts.places.chunks_exact(m).map(<[f64]>::to_vec).collect(),
            centre: parts.centre,
            deviation: parts.deviation,
            spreads: parts.spreads,
            threshold: parts.threshold,
        })
    }
}

/// L⁻¹ v.
fn whitened(factor: &Mat<f64>, v: &[f64]) -> Vec<f64> {
    let mut solved = v.to_vec();
    solve_lower(factor, &mut solved);
    solved
}

fn scaled(features: &[f64], centre: &[f64], deviation: &[f64]) -> Vec<f64> {
    let each = features.iter().zip(centre).zip(deviation);
    each.map(|((f, c), d)| (f - c) / d).collect()
}

/// Distance and number of the places nearest to one, without a place itself.
fn nearest(place: &[f64], places: &[Vec<f64>], without: Option<usize>) -> Vec<(f64, usize)> {
    let distance = |other: &[f64]| {
        other
            .iter()
            .zip(place)
            .map(|(a, b)| (a - b).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let mut found: Vec<(f64, usize)> = places.iter().map(|other| distance(other)).zip(0..).collect();
    if let Some(own) = without {
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
