//! How far a prediction may be off, for each pattern: intervals that hold with 95 % probability, and a flag for patterns out
//! of the distribution of those that the network learned from.
//!
//! Split-conformal prediction (Vovk, Gammerman and Shafer, Algorithmic Learning in a Random World (2005), chapter 4; Lei et
//! al., J. Am. Stat. Assoc. 113 (2018) 1094), made local: what a field is off by depends on the pattern, so one radius for all
//! would be too wide for most of them and too narrow for some families. On one half of the calibration patterns a regression
//! learns the median of the logarithm of the error from features that cost nothing ([`features`]). On the other half the
//! difference from that median is the score, and the score of a new pattern is taken to be, with 95 % probability, below
//! the conformal quantile, ⌈0.95 (k + 1)⌉ of k, of the k calibration patterns nearest to it in the space of the features
//! (Guan, Biometrika 110 (2023) 33).
//!
//! The interval of a **field** is a simultaneous band: with 95 % probability *every* component at *every* corner lies within
//! ± radius of the predicted one. The interval of an **objective**, a number that is linear in the field, is ± half-width about
//! the predicted number; it is made of the same residual fields, so the points may be chosen later.
//!
//! The probability is over patterns like those of the calibration. Of others nothing is known, hence the flag: a pattern
//! is **out of distribution** when its novelty, the distance to the nearest familiar patterns, in units of the distances that these have among
//! themselves (a local outlier factor: Breunig et al., SIGMOD Record 29 (2000) 93), is larger than that of 99 % of fresh
//! familiar patterns.

mod difficulty;
mod features;
mod novelty;

use difficulty::Difficulty;
use features::{DIFFICULTY, difficulty_features, novelty_features};
use novelty::Novelty;

pub use difficulty::DifficultyParts;
pub use novelty::NoveltyParts;

use deaflow_base::Stream;
use deaflow_field::Field;
use deaflow_pattern::{Pattern, Raster};

/// Probability that an interval covers what it is about.
pub const COVERAGE: f64 = 0.95;

/// Share of fresh familiar patterns that are flagged as out of distribution.
pub const FALSE_ALARM: f64 = 0.01;

/// The fewest patterns that a calibration is made from: of their second half, one is allowed to lie outside.
pub const LEAST: usize = 80;

/// Patterns of the second half whose residual fields are kept for objectives.
const RESIDUALS: usize = 1000;

/// Errors below this count as this, in mm: a pattern that does not move is predicted exactly.
const FLOOR: f64 = 1e-6;

/// A pattern with what was predicted and what was simulated.
pub struct Observed {
    raster: Raster,
    features: Features,
    /// Predicted less simulated, mm.
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

impl Observed {
    /// A calibration pattern; `familiar` says whether it is like what the network learned from.
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

    /// The natural logarithm of the largest error of a component in mm.
    fn log_error(&self) -> f64 {
        self.largest.max(FLOOR).ln()
    }
}

fn largest(residual: &[f32]) -> f64 {
    f64::from(residual.iter().fold(0.0f32, |largest, r| largest.max(r.abs())))
}

/// A calibration that cannot be made or read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CalibrationError {
    /// Too few patterns.
    #[error("a calibration needs {LEAST} patterns that the network never saw, found {0}")]
    Few(usize),
    /// Too few patterns like those of the training.
    #[error("a calibration needs {LEAST} patterns of the families that the network learned from, found {0}")]
    FewFamiliar(usize),
    /// Patterns or fields with values that are no numbers.
    #[error("the calibration has no solution: a feature of its patterns is no number")]
    Singular,
    /// Arrays that do not belong together.
    #[error("the arrays of the calibration do not fit together: {0}")]
    Parts(&'static str),
}

/// What is said of one prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// With 95 % probability every component at every corner lies within this of the predicted one, mm.
    pub radius_mm: f64,
    /// How far the pattern is from those of the training: 1 is the threshold of the flag.
    pub novelty: f64,
    /// Whether the pattern is out of the distribution of the training: then nothing is promised.
    pub out_of_distribution: bool,
}

/// The arrays of a calibration, as they stand in files.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationParts {
    /// The cells of the patterns.
    pub raster: Raster,
    /// The regression and its neighbours.
    pub difficulty: DifficultyParts,
    /// Residual fields in mm of the first of the neighbours, end to end.
    pub residuals: Vec<f32>,
    /// The familiar patterns.
    pub novelty: NoveltyParts,
}

/// Intervals and flags for the predictions of one network.
pub struct Calibration {
    raster: Raster,
    difficulty: Difficulty,
    residuals: Vec<f32>,
    novelty: Novelty,
}

impl Calibration {
    /// A calibration from patterns that the network never saw. The seed draws which half they are in.
    ///
    /// # Errors
    /// When there are too few patterns, or too few familiar ones.
    pub fn fit(mut observed: Vec<Observed>, seed: u64) -> Result<Self, CalibrationError> {
        if observed.len() < LEAST {
            return Err(CalibrationError::Few(observed.len()));
        }
        let familiar = observed.iter().filter(|o| o.familiar).count();
        if familiar < LEAST {
            return Err(CalibrationError::FewFamiliar(familiar));
        }
        Stream::new(seed, "calibration halves", 0).shuffle(&mut observed);
        let known: Vec<&[f64]> = observed
            .iter()
            .filter(|o| o.familiar)
            .map(|o| &o.features.novelty[..])
            .collect();
        let novelty = Novelty::fit(&known, FALSE_ALARM)?;
        let pairs: Vec<([f64; DIFFICULTY], f64)> = observed
            .iter()
            .map(|o| (o.features.difficulty, o.log_error()))
            .collect();
        let (first, second) = pairs.split_at(pairs.len() / 2);
        let rows = observed[first.len()..].iter().take(RESIDUALS);
        let raster = observed[0].raster;
        if observed.iter().any(|o| o.raster != raster) {
            return Err(CalibrationError::Parts("patterns of several membranes"));
        }
        Ok(Self {
            raster,
            difficulty: Difficulty::fit(first, second)?,
            residuals: rows.flat_map(|o| o.residual.iter().copied()).collect(),
            novelty,
        })
    }

    /// What is said of the prediction of a pattern.
    #[must_use]
    pub fn interval(&self, pattern: &Pattern, predicted: &Field) -> Interval {
        let features = Features::of(pattern, predicted);
        let place = self.difficulty.place(&features.difficulty);
        let novelty = self.novelty.novelty(&features.novelty);
        Interval {
            radius_mm: self
                .difficulty
                .quantile(&place, self.difficulty.scores(), COVERAGE)
                .exp()
                * place.median,
            novelty,
            out_of_distribution: novelty > 1.0,
        }
    }

    /// Intervals of a number that is linear in the field, such as the displacement of a point along a direction.
    #[must_use]
    pub fn objective(&self, value: &dyn Fn(&Field) -> f64) -> ObjectiveIntervals<'_> {
        let values = 2 * self.raster.corners();
        let rows = self.residuals.chunks_exact(values).zip(self.difficulty.medians());
        let score = |(residual, median): (&[f32], f64)| {
            let field = Field::from_values(self.raster, residual.iter().map(|&r| f64::from(r)).collect());
            // Residuals are checked to be finite when a calibration is read, and are when one is fitted.
            field.map_or(0.0, |field| value(&field).abs()) / median
        };
        ObjectiveIntervals {
            calibration: self,
            scores: rows.map(score).collect(),
        }
    }

    /// The arrays.
    #[must_use]
    pub fn parts(&self) -> CalibrationParts {
        CalibrationParts {
            raster: self.raster,
            difficulty: self.difficulty.parts(),
            residuals: self.residuals.clone(),
            novelty: self.novelty.parts(),
        }
    }

    /// The calibration of arrays.
    ///
    /// # Errors
    /// When they do not fit together.
    pub fn from_parts(parts: CalibrationParts) -> Result<Self, CalibrationError> {
        let difficulty = Difficulty::from_parts(parts.difficulty)?;
        let values = 2 * parts.raster.corners();
        let rows = parts.residuals.len() / values;
        if !parts.residuals.len().is_multiple_of(values) || rows == 0 || rows > difficulty.scores().len() {
            return Err(CalibrationError::Parts("residuals"));
        }
        if parts.residuals.iter().any(|r| !r.is_finite()) {
            return Err(CalibrationError::Parts("a residual is no number"));
        }
        Ok(Self {
            raster: parts.raster,
            difficulty,
            residuals: parts.residuals,
            novelty: Novelty::from_parts(parts.novelty)?,
        })
    }
}

/// Intervals of one objective.
pub struct ObjectiveIntervals<'a> {
    calibration: &'a Calibration,
    /// Of the objective's error in units of the median largest error.
    scores: Vec<f64>,
}

impl ObjectiveIntervals<'_> {
    /// With 95 % probability the objective of a pattern lies within this of the predicted one; in its own unit.
    #[must_use]
    pub fn half_width(&self, pattern: &Pattern, predicted: &Field) -> f64 {
        let difficulty = &self.calibration.difficulty;
        let place = difficulty.place(&difficulty_features(pattern, predicted));
        difficulty.quantile(&place, &self.scores, COVERAGE) * place.median
    }
}

#[cfg(test)]
mod tests;
