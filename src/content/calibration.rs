//! The artifact of a calibrate stage.

use super::attribute::Lines;
use super::dropped::DroppedRows;
use super::element::SingleField;
use super::macros::arrays;
use deaflow_scene::Scene;

arrays! {
    /// Prediction intervals of a model.
    pub struct Calibration, CalibrationView {
        /// Families of the calibration.
        families: Vec<String> = array("families", "", [families]),
        /// Patterns of each.
        samples: Vec<u64> = array("samples", "1", [families]),
        /// 1 if the model was trained on the family.
        familiar: Vec<u64> = array("familiar", "1", [families]),
        /// The difficulty of patterns, for intervals.
        difficulty: Difficulty = group("difficulty"),
        /// The novelty of patterns, for the flag `out_of_distribution`.
        novelty: Novelty = group("likeness"),
        /// Predicted minus simulated displacement of the first patterns.
        residuals: Vec<SingleField> = array("residuals", "mm", [residual, corner_y, corner_x, xy]),
        /// Coverage probability of the intervals.
        coverage: String = attribute("coverage"),
        /// Share of new patterns of the training families that are flagged.
        false_alarm: String = attribute("false_alarm"),
        /// The artifact of the model.
        model: String = attribute("model"),
        /// BLAKE3 of the bytes of the model, which identifies a file of it.
        weights: String = attribute("weights"),
        /// The network.
        network: String = attribute("network"),
        /// Rows that `without` dropped.
        dropped: Option<DroppedRows> = group("dropped"),
        /// What `without` dropped, one line per audit or list of marked rows.
        without: Option<Lines> = attribute("without"),
        /// The scene of the patterns.
        scene: Scene = attribute("scene"),
    }
}

arrays! {
    /// How difficult patterns are to predict.
    #[derive(Default)]
    pub struct Difficulty, DifficultyView {
        /// Mean of each feature.
        centre: Vec<f64> = array("centre", "1", [difficulty_feature]),
        /// Deviation of each feature.
        deviation: Vec<f64> = array("deviation", "1", [difficulty_feature]),
        /// Bounds of the logarithm of the median error.
        range: Vec<f64> = array("range", "1", [bound]),
        /// Coefficients of the median of ln(largest error in mm), a quadratic in the scaled features.
        coefficients: Vec<f64> = array("coefficients", "1", [term]),
        /// Scaled features.
        places: Vec<f64> = array("places", "1", [calibration_pattern, difficulty_feature]),
        /// ln(largest error in mm) minus its median, of each pattern.
        scores: Vec<f64> = array("scores", "1", [calibration_pattern]),
    }
}

arrays! {
    /// How far patterns are from the training patterns.
    #[derive(Default)]
    pub struct Novelty, NoveltyView {
        /// Mean of each feature.
        centre: Vec<f64> = array("centre", "1", [novelty_feature]),
        /// Deviation of each feature.
        deviation: Vec<f64> = array("deviation", "1", [novelty_feature]),
        /// Lower Cholesky factor of the covariance of the scaled features.
        factor: Vec<f64> = array("factor", "1", [novelty_feature, factor_column]),
        /// Decorrelated features of familiar patterns.
        places: Vec<f64> = array("places", "1", [familiar_pattern, novelty_feature]),
        /// Mean distance of each familiar pattern to its nearest neighbours.
        spreads: Vec<f64> = array("spreads", "1", [familiar_pattern]),
        /// Relative distance above which a pattern is out of distribution.
        threshold: [f64; 1] = array("threshold", "1", [single]),
    }
}
