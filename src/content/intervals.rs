//! Prediction intervals in files of predictions and in artifacts of designs.

use super::macros::arrays;
use super::part::LongTexts;

arrays! {
    /// Intervals of predictions by a calibration.
    #[derive(Default)]
    pub struct PredictionIntervals, PredictionIntervalsView {
        /// With the stated probability, every component at every corner differs from the prediction by at most this.
        radius: Vec<f64> = array("radius", "mm", [sample]),
        /// Lower end of the interval of the largest displacement magnitude.
        max_displacement_lower: Vec<f64> = array("max_displacement_lower", "mm", [sample]),
        /// Upper end of the interval of the largest displacement magnitude.
        max_displacement_upper: Vec<f64> = array("max_displacement_upper", "mm", [sample]),
        /// Relative distance of the pattern from the training patterns; above 1 it is out of distribution.
        novelty: Vec<f64> = array("novelty", "1", [sample]),
        /// 1 if the pattern is out of distribution, so that the interval is not valid.
        out_of_distribution: Vec<u8> = array("out_of_distribution", "1", [sample]),
        /// Intervals of the requested objectives.
        objective: Option<ObjectiveIntervals> = group("objective"),
    }
}

arrays! {
    /// Displacements along target directions with their intervals.
    #[derive(Default)]
    pub struct ObjectiveIntervals, ObjectiveIntervalsView {
        /// Each objective in YAML.
        text: LongTexts = array("yaml", "", [objective]),
        /// Predicted mean displacement along the target directions.
        predicted: Vec<f64> = array("predicted", "mm", [objective, sample]),
        /// Lower end of the interval.
        lower: Vec<f64> = array("lower", "mm", [objective, sample]),
        /// Upper end of the interval.
        upper: Vec<f64> = array("upper", "mm", [objective, sample]),
    }
}

arrays! {
    /// Predictions of calibrated networks for designs; zeros and empty texts without one.
    #[derive(Default)]
    pub struct DesignIntervals, DesignIntervalsView {
        /// Coverage probability of the interval; 0 if there is no interval.
        coverage: Vec<f64> = array("coverage", "1", [row]),
        /// Mean displacement along the target directions predicted by the network.
        predicted: Vec<f64> = array("predicted", "mm", [row]),
        /// Lower end of the interval.
        lower: Vec<f64> = array("lower", "mm", [row]),
        /// Upper end of the interval.
        upper: Vec<f64> = array("upper", "mm", [row]),
        /// Relative distance of the pattern from the training patterns; above 1 it is out of distribution.
        novelty: Vec<f64> = array("novelty", "1", [row]),
        /// 1 if the pattern is out of distribution, so that the interval is not valid.
        out_of_distribution: Vec<u64> = array("out_of_distribution", "1", [row]),
        /// The families of the calibration patterns.
        basis: LongTexts = array("calibrated_on", "", [row]),
    }
}

/// The interval of one design.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignInterval {
    /// Coverage probability.
    pub coverage: f64,
    /// Mean displacement along the target directions predicted by the network, mm.
    pub predicted_mm: f64,
    /// Its ends, mm.
    pub ends_mm: [f64; 2],
    /// Relative distance of the pattern from the training patterns; above 1 it is out of distribution.
    pub novelty: f64,
    /// Whether it is out of distribution, so that the interval is not valid.
    pub out_of_distribution: bool,
    /// The families of the calibration patterns.
    pub basis: String,
}

impl DesignIntervals {
    /// Intervals of a number of designs, none of which has one.
    #[must_use]
    pub fn none(rows: usize) -> Self {
        let mut none = Self::default();
        (0..rows).for_each(|_| none.push(None));
        none
    }

    /// Adds the interval of a design.
    pub fn push(&mut self, interval: Option<DesignInterval>) {
        let found = interval.as_ref();
        let number = |of: fn(&DesignInterval) -> f64| found.map_or(0.0, of);
        self.coverage.push(number(|interval| interval.coverage));
        self.predicted.push(number(|interval| interval.predicted_mm));
        self.lower.push(number(|interval| interval.ends_mm[0]));
        self.upper.push(number(|interval| interval.ends_mm[1]));
        self.novelty.push(number(|interval| interval.novelty));
        let flagged = found.is_some_and(|interval| interval.out_of_distribution);
        self.out_of_distribution.push(u64::from(flagged));
        self.basis
            .0
            .push(interval.map_or_else(String::new, |interval| interval.basis));
    }

    /// Returns the interval of a design.
    #[must_use]
    pub fn of_row(&self, row: usize) -> Option<DesignInterval> {
        (self.coverage[row] > 0.0).then(|| DesignInterval {
            coverage: self.coverage[row],
            predicted_mm: self.predicted[row],
            ends_mm: [self.lower[row], self.upper[row]],
            novelty: self.novelty[row],
            out_of_distribution: self.out_of_distribution[row] == 1,
            basis: self.basis.0[row].clone(),
        })
    }
}
