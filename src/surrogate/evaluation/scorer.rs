//! Compares several predictors and the intervals of their calibrations with simulations.

use rayon::prelude::*;

use super::coverage::{Coverage, intervals};
use super::score::PatternScore;
use crate::{Calibration, ObjectiveIntervals};
use deaflow_field::{Field, PredictError, Predictor};
use deaflow_pattern::Pattern;

/// Predictors, and calibrations of some of them.
pub struct Scorer<'a> {
    predictors: Vec<&'a dyn Predictor>,
    calibrated: Vec<Calibrated<'a>>,
}

/// A calibration with the index of its predictor and the intervals of the objectives.
struct Calibrated<'a> {
    predictor: usize,
    calibration: &'a Calibration,
    intervals: Vec<ObjectiveIntervals<'a>>,
}

/// The scores of a labelled pattern.
#[derive(Clone, Debug)]
pub struct RowScores {
    /// By predictor; `None` where it has no field.
    pub scores: Vec<Option<PatternScore>>,
    /// By calibration.
    pub coverage: Vec<Coverage>,
}

impl<'a> Scorer<'a> {
    /// Creates a scorer of predictors and of calibrations, each with the index of its predictor.
    #[must_use]
    pub fn new(
        predictors: Vec<&'a dyn Predictor>,
        calibrations: impl Iterator<Item = (usize, &'a Calibration)>,
    ) -> Self {
        let calibrated = calibrations.map(|(predictor, calibration)| Calibrated {
            predictor,
            calibration,
            intervals: intervals(calibration),
        });
        Self {
            predictors,
            calibrated: calibrated.collect(),
        }
    }

    /// Predicts patterns and compares the predictions with the simulated fields.
    ///
    /// # Errors
    /// When a predictor cannot be evaluated.
    pub fn score(&self, patterns: &[Pattern], simulated: &[Field]) -> Result<Vec<RowScores>, PredictError> {
        let predicted = self.predictors.iter().map(|predictor| predictor.predict_some(patterns));
        let predicted: Vec<Vec<Option<Field>>> = predicted.collect::<Result<_, _>>()?;
        let one = |at: usize| {
            let (pattern, simulated) = (&patterns[at], &simulated[at]);
            let score = |fields: &Vec<Option<Field>>| Some(PatternScore::of(fields[at].as_ref()?, simulated));
            let coverage = self.calibrated.iter().filter_map(|calibrated| {
                let field = predicted[calibrated.predictor][at].as_ref()?;
                let (calibration, intervals) = (calibrated.calibration, &calibrated.intervals);
                Some(Coverage::of(calibration, intervals, pattern, field, simulated))
            });
            RowScores {
                scores: predicted.iter().map(score).collect(),
                coverage: coverage.collect(),
            }
        };
        Ok((0..patterns.len()).into_par_iter().map(one).collect())
    }
}
