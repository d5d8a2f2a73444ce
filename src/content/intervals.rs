//! How far predictions may be off, as files of predictions and artifacts of designs hold it.

use super::macros::arrays;
use super::part::LongTexts;

arrays! {
    /// Intervals of predictions by a calibration.
    #[derive(Default)]
    pub struct PredictionIntervals, PredictionIntervalsView {
        /// With the stated probability every component at every corner lies within this of the predicted one.
        radius: Vec<f64> = array("radius", "mm", [sample]),
        /// Lower end of the interval of the largest displacement magnitude.
        max_displacement_lower: Vec<f64> = array("max_displacement_lower", "mm", [sample]),
        /// Upper end of the interval of the largest displacement magnitude.
        max_displacement_upper: Vec<f64> = array("max_displacement_upper", "mm", [sample]),
        /// How far the pattern is from those of the training: above 1 it is out of distribution.
        novelty: Vec<f64> = array("novelty", "1", [sample]),
        /// 1 where the pattern is out of distribution, so that nothing is promised.
        out_of_distribution: Vec<u8> = array("out_of_distribution", "1", [sample]),
        /// Numbers that were asked for.
        objective: Option<ObjectiveIntervals> = group("objective"),
    }
}

arrays! {
    /// Displacements along wanted directions with their intervals.
    #[derive(Default)]
    pub struct ObjectiveIntervals, ObjectiveIntervalsView {
        /// Each objective in YAML.
        text: LongTexts = array("yaml", "", [objective]),
        /// Predicted mean displacement along the wanted directions.
        predicted: Vec<f64> = array("predicted", "mm", [objective, sample]),
        /// Lower end of its interval.
        lower: Vec<f64> = array("lower", "mm", [objective, sample]),
        /// Upper end of its interval.
        upper: Vec<f64> = array("upper", "mm", [objective, sample]),
    }
}

arrays! {
    /// What a calibrated network says of designs; zeros and empty texts where none was asked.
    #[derive(Default)]
    pub struct DesignIntervals, DesignIntervalsView {
        /// Probability that the interval covers; 0 where there is no interval.
        coverage: Vec<f64> = array("coverage", "1", [row]),
        /// Mean displacement along the wanted directions as the network predicts it.
        predicted: Vec<f64> = array("predicted", "mm", [row]),
        /// Lower end of its interval.
        lower: Vec<f64> = array("lower", "mm", [row]),
        /// Upper end of its interval.
        upper: Vec<f64> = array("upper", "mm", [row]),
        /// How far the pattern is from those of the training: above 1 it is out of distribution.
        novelty: Vec<f64> = array("novelty", "1", [row]),
        /// 1 where the pattern is out of distribution, so that nothing is promised.
        out_of_distribution: Vec<u64> = array("out_of_distribution", "1", [row]),
        /// The families that the calibration was made from.
        basis: LongTexts = array("calibrated_on", "", [row]),
    }
}

/// The interval of one design.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignInterval {
    /// Probability that it covers.
    pub coverage: f64,
    /// Mean displacement along the wanted directions as the network predicts it, mm.
    pub predicted_mm: f64,
    /// Its ends, mm.
    pub ends_mm: [f64; 2],
    /// How far the pattern is from those of the training: above 1 it is out of distribution.
    pub novelty: f64,
    /// Whether it is, so that nothing is promised.
    pub out_of_distribution: bool,
    /// The families that the calibration was made from.
    pub basis: String,
}

impl DesignIntervals {
    /// Of so many designs, none with an interval.
    #[must_use]
    pub fn none(rows: usize) -> Self {
        let mut none = Self::default();
        (0..rows).for_each(|_| none.push(None));
        none
    }

    /// Adds a design.
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

    /// That of a design.
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
