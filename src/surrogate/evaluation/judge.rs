//! Holds predictions of several predictors, and the intervals of their calibrations, against simulations.

use rayon::prelude::*;

use super::coverage::{Coverage, intervals};
use super::score::PatternScore;
use crate::{Calibration, ObjectiveIntervals};
use deaflow_field::{Field, PredictError, Predictor};
use deaflow_pattern::Pattern;

/// Predictors to be judged, and calibrations of some of them.
pub struct Judge<'a> {
    predictors: Vec<&'a dyn Predictor>,
    calibrated: Vec<Calibrated<'a>>,
}

/// A calibration with the place of its predictor and the intervals of the objectives.
struct Calibrated<'a> {
    predictor: usize,
    calibration: &'a Calibration,
    intervals: Vec<ObjectiveIntervals<'a>>,
}

/// One labelled pattern and what was said of it.
#[derive(Clone, Debug)]
pub struct Judged {
    /// By predictor; none where it has no field.
    pub scores: Vec<Option<PatternScore>>,
    /// By calibration.
    pub coverage: Vec<Coverage>,
}

impl<'a> Judge<'a> {
    /// Of predictors and calibrations, each with the place of its predictor.
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

    /// Judges what is said of patterns by their simulated fields.
    ///
    /// # Errors
    /// When a predictor cannot be evaluated.
    pub fn judge(&self, patterns: &[Pattern], simulated: &[Field]) -> Result<Vec<Judged>, PredictError> {
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
            Judged {
                scores: predicted.iter().map(score).collect(),
                coverage: coverage.collect(),
            }
        };
        Ok((0..patterns.len()).into_par_iter().map(one).collect())
    }
}
