//! Calibration of surrogates: prediction intervals with 95 % probability, and a flag for patterns out of the training
//! distribution.
//!
//! The intervals use split-conformal prediction (Vovk, Gammerman and Shafer, Algorithmic Learning in a Random World
//! (2005), chapter 4; Lei et al., J. Am. Stat. Assoc. 113 (2018) 1094) in a local form. The error of a field depends
//! on the pattern, so a common radius would be too wide for most patterns and too narrow for some families. A
//! regression on one half of the calibration patterns predicts the median of the logarithm of the error from cheap
//! features ([`features`]). On the other half, the difference from that median is the score. With 95 % probability the
//! score of a new pattern is below the conformal quantile, ⌈0.95 (k + 1)⌉ of k, of the k nearest calibration patterns
//! in feature space (Guan, Biometrika 110 (2023) 33).
//!
//! The interval of a **field** is a simultaneous band: with 95 % probability *every* component at *every* corner lies
//! within ± radius of the prediction. The interval of an **objective**, a linear function of the field, is ±
//! half-width about the prediction. It is computed from stored residual fields, so the objective may be chosen after
//! the calibration.
//!
//! The probability holds for patterns like those of the calibration, hence the flag. The novelty of a pattern is its
//! distance to the nearest familiar patterns relative to their distances from each other (a local outlier factor:
//! Breunig et al., SIGMOD Record 29 (2000) 93). A pattern is **out of distribution** when its novelty exceeds that of
//! 99 % of fresh familiar patterns.

mod difficulty;
mod error;
mod features;
mod novelty;

use difficulty::Difficulty;
use features::{DIFFICULTY, difficulty_features, novelty_features};
use novelty::Novelty;

pub use difficulty::{COVERAGE, DifficultyParts};
pub use error::{CalibrationError, MIN_PATTERNS};
pub use novelty::NoveltyParts;

use deaflow_base::Stream;
use deaflow_field::Field;
use deaflow_pattern::{Pattern, Raster};

/// Share of fresh familiar patterns that are flagged as out of distribution.
pub const FALSE_ALARM: f64 = 0.01;

/// Number of patterns of the second half whose residual fields are stored for objectives.
const RESIDUALS: usize = 1000;

/// Lower bound of errors in mm. A pattern that does not move may be predicted exactly.
const FLOOR: f64 = 1e-6;

/// A pattern with its predicted and its simulated field.
pub struct CalibrationSample {
    raster: Raster,
    features: Features,
    /// Predicted minus simulated field, mm.
    residual: Vec<f32>,
    largest: f64,
    familiar: bool,
}

struct Features {
    difficulty: [f64; DIFFICULTY],
    novelty: Vec<f64>,
}

impl Features {
    fn of(pattern: &Pattern, predicted: &Field) -> Self {
        let difficulty = difficulty_features(pattern, predicted);
        Self {
            novelty: novelty_features(pattern, &difficulty),
            difficulty,
        }
    }
}

impl CalibrationSample {
    /// Creates a sample. `familiar` says whether the pattern belongs to a training family.
    #[must_use]
    pub fn new(pattern: &Pattern, predicted: &Field, simulated: &Field, familiar: bool) -> Self {
        let pairs = predicted.values().iter().zip(simulated.values());
        let residual: Vec<f32> = pairs.map(|(p, s)| (p - s) as f32).collect();
        Self {
            raster: predicted.raster(),
            features: Features::of(pattern, predicted),
            largest: largest(&residual),
            residual,
            familiar,
        }
    }

    /// Returns the natural logarithm of the largest error of a component in mm.
    fn log_error(&self) -> f64 {
        self.largest.max(FLOOR).ln()
    }
}

fn largest(residual: &[f32]) -> f64 {
    f64::from(residual.iter().fold(0.0f32, |largest, r| largest.max(r.abs())))
}

/// Interval and novelty of a prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// With 95 % probability every component at every corner differs from the prediction by at most this, mm.
    pub radius_mm: f64,
    /// Relative distance of the pattern from familiar patterns; the threshold is 1.
    pub novelty: f64,
    /// Whether the pattern is out of the training distribution; the interval is then not valid.
    pub out_of_distribution: bool,
}

/// The arrays of a calibration in files.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationParts {
    /// Cells of the patterns.
    pub raster: Raster,
    /// The regression and the scores.
    pub difficulty: DifficultyParts,
    /// Residual fields in mm of the first scored patterns, concatenated.
    pub residuals: Vec<f32>,
    /// The familiar patterns.
    pub novelty: NoveltyParts,
}

/// Computes intervals and flags for the predictions of a network.
pub struct Calibration {
    raster: Raster,
    difficulty: Difficulty,
    residuals: Vec<f32>,
    novelty: Novelty,
}

impl Calibration {
    /// Fits a calibration to patterns that were not used in training. The seed divides them into halves.
    ///
    /// # Errors
    /// When there are too few patterns, or too few familiar ones.
    pub fn fit(mut samples: Vec<CalibrationSample>, seed: u64) -> Result<Self, CalibrationError> {
        if samples.len() < MIN_PATTERNS {
            return Err(CalibrationError::Few(samples.len()));
        }
        let count = samples.iter().filter(|sample| sample.familiar).count();
        if count < MIN_PATTERNS {
            return Err(CalibrationError::FewFamiliar(count));
        }
        Stream::new(seed, "calibration halves", 0).shuffle(&mut samples);
        let familiar = samples.iter().filter(|sample| sample.familiar);
        let familiar: Vec<&[f64]> = familiar.map(|sample| &sample.features.novelty[..]).collect();
        let novelty = Novelty::fit(&familiar, FALSE_ALARM)?;
        let pairs = samples
            .iter()
            .map(|sample| (sample.features.difficulty, sample.log_error()));
        let pairs: Vec<([f64; DIFFICULTY], f64)> = pairs.collect();
        let (first, second) = pairs.split_at(pairs.len() / 2);
        let stored = samples[first.len()..].iter().take(RESIDUALS);
        let raster = samples[0].raster;
        if samples.iter().any(|sample| sample.raster != raster) {
            return Err(CalibrationError::Parts("patterns of several membranes"));
        }
        Ok(Self {
            raster,
            difficulty: Difficulty::fit(first, second)?,
            residuals: stored.flat_map(|sample| sample.residual.iter().copied()).collect(),
            novelty,
        })
    }

    /// Returns interval and novelty of the prediction of a pattern.
    #[must_use]
    pub fn interval(&self, pattern: &Pattern, predicted: &Field) -> Interval {
        let features = Features::of(pattern, predicted);
        let novelty = self.novelty.novelty(&features.novelty);
        let (median, quantile) = self.difficulty.median_and_quantile(&features.difficulty, None);
        Interval {
            radius_mm: quantile.exp() * median,
            novelty,
            out_of_distribution: novelty > 1.0,
        }
    }

    /// Returns intervals of an objective that is linear in the field, such as the displacement of a point in a
    /// direction.
    #[must_use]
    pub fn objective(&self, value: &dyn Fn(&Field) -> f64) -> ObjectiveIntervals<'_> {
        let values = 2 * self.raster.corners();
        let rows = self.residuals.chunks_exact(values).zip(self.difficulty.medians());
        let score = |(residual, median): (&[f32], f64)| {
            let field = Field::from_values(self.raster, residual.iter().map(|&r| f64::from(r)).collect());
            // The residuals are finite: `from_parts` checks them.
            field.map_or(0.0, |field| value(&field).abs()) / median
        };
        ObjectiveIntervals {
            calibration: self,
            scores: rows.map(score).collect(),
        }
    }

    /// Returns the arrays.
    #[must_use]
    pub fn parts(&self) -> CalibrationParts {
        CalibrationParts {
            raster: self.raster,
            difficulty: self.difficulty.parts(),
            residuals: self.residuals.clone(),
            novelty: self.novelty.parts(),
        }
    }

    /// Creates a calibration from its arrays.
    ///
    /// # Errors
    /// When the arrays are inconsistent.
    pub fn from_parts(parts: CalibrationParts) -> Result<Self, CalibrationError> {
        let difficulty = Difficulty::from_parts(parts.difficulty)?;
        let values = 2 * parts.raster.corners();
        let rows = parts.residuals.len() / values;
        if !parts.residuals.len().is_multiple_of(values) || rows == 0 || rows > difficulty.len() {
            return Err(CalibrationError::Parts("residuals"));
        }
        if parts.residuals.iter().any(|r| !r.is_finite()) {
            return Err(CalibrationError::Parts("a residual is not a number"));
        }
        Ok(Self {
            raster: parts.raster,
            difficulty,
            residuals: parts.residuals,
            novelty: Novelty::from_parts(parts.novelty)?,
        })
    }
}

/// Intervals of an objective.
pub struct ObjectiveIntervals<'a> {
    calibration: &'a Calibration,
    /// Errors of the objective relative to the median of the largest error.
    scores: Vec<f64>,
}

impl ObjectiveIntervals<'_> {
    /// Returns the half-width of the interval in the unit of the objective: with 95 % probability the simulated value
    /// differs from the prediction by at most this.
    #[must_use]
    pub fn half_width(&self, pattern: &Pattern, predicted: &Field) -> f64 {
        let features = difficulty_features(pattern, predicted);
        let difficulty = &self.calibration.difficulty;
        let (median, quantile) = difficulty.median_and_quantile(&features, Some(&self.scores));
        quantile * median
    }
}

#[cfg(test)]
mod tests;
