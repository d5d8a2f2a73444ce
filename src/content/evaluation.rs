//! The artifact of an evaluate stage.

use super::macros::arrays;
use deaflow_scene::Scene;

arrays! {
    /// Errors of models and estimates on patterns that were not used for training.
    pub struct Evaluation, EvaluationView {
        /// Network or method.
        predictors: Vec<String> = array("predictors", "", [predictors]),
        /// Artifact of a model; empty for an estimate.
        predictor_digests: Vec<String> = array("predictor_digests", "", [predictors]),
        /// Families of the patterns; the last entry is all families together.
        families: Vec<String> = array("families", "", [families]),
        /// 1 if a model was trained on the family; for all families if it was trained on each.
        trained: Vec<u64> = array("trained", "1", [predictors, families]),
        /// Scores by family.
        score: Scores = group("score", [(group, families)]),
        /// Middle of each bin of the area, 5 % of the free membrane wide.
        area_centre: Vec<f64> = array("area/centre", "1", [area_bin]),
        /// Scores by area fraction.
        area: Scores = group("area", [(group, area_bin)]),
        /// Scores of every pattern.
        pattern: PatternScores = group("pattern"),
        /// Coverage of intervals, if there are calibrations.
        coverage: Option<Coverage> = group("coverage"),
        /// The scene of the patterns.
        scene: Scene = attribute("scene"),
    }
}

arrays! {
    /// Scores of each predictor in groups of patterns. A group without predictions has 0 samples.
    #[derive(Default)]
    pub struct Scores, ScoresView {
        /// Patterns with a prediction.
        samples: Vec<u64> = array("samples", "1", [predictors, group]),
        /// Root mean square error per component.
        rmse: Vec<f64> = array("rmse", "mm", [predictors, group]),
        /// Coefficient of determination of the components.
        r2: Vec<f64> = array("r2", "1", [predictors, group]),
        /// Coefficient of determination of the largest displacement.
        max_displacement_r2: Vec<f64> = array("max_displacement_r2", "1", [predictors, group]),
        /// Largest absolute error of a component.
        max_error: Vec<f64> = array("max_error", "mm", [predictors, group]),
        /// Largest magnitude of the error of a displacement.
        max_displacement_error: Vec<f64> = array("max_displacement_error", "mm", [predictors, group]),
        /// 95 % quantile of the largest error of a pattern.
        quantile95: Vec<f64> = array("quantile95", "mm", [predictors, group]),
    }
}

arrays! {
    /// Scores of every pattern; 0 without a prediction.
    #[derive(Default)]
    pub struct PatternScores, PatternScoresView {
        /// Family of each pattern.
        family: Vec<String> = array("family", "", [row]),
        /// Electrode area of each pattern, a share of the free membrane.
        area: Vec<f64> = array("area", "1", [row]),
        /// Largest simulated displacement of each pattern.
        simulated_max: Vec<f64> = array("simulated_max", "mm", [row]),
        /// 1 if there is a prediction.
        predicted: Vec<u8> = array("predicted", "1", [predictors, row]),
        /// Largest predicted displacement; 0 without a prediction.
        predicted_max: Vec<f64> = array("predicted_max", "mm", [predictors, row]),
        /// Root mean square error of a component; 0 without a prediction.
        rms: Vec<f64> = array("rms", "mm", [predictors, row]),
        /// Largest absolute error of a component; 0 without a prediction.
        max_error: Vec<f64> = array("max_error", "mm", [predictors, row]),
    }
}

arrays! {
    /// Coverage of the intervals of calibrations.
    #[derive(Default)]
    pub struct Coverage, CoverageView {
        /// Artifact of each calibration.
        calibrations: Vec<String> = array("calibrations", "", [calibrations]),
        /// Artifact of its model.
        models: Vec<String> = array("models", "", [calibrations]),
        /// Number of calibration patterns of each family.
        calibrated: Vec<u64> = array("calibrated", "1", [calibrations, families]),
        /// Objectives: points and directions.
        objectives: Vec<String> = array("objectives", "", [objectives]),
        /// Share of patterns whose entire field is in its band.
        field: Vec<f64> = array("field", "1", [calibrations, families]),
        /// Median radius of the band.
        radius: Vec<f64> = array("radius", "mm", [calibrations, families]),
        /// Share of patterns flagged as out of distribution.
        out_of_distribution: Vec<f64> = array("unlike", "1", [calibrations, families]),
        /// Number of patterns that are not flagged.
        unflagged: Vec<u64> = array("unflagged", "1", [calibrations, families]),
        /// Share of these whose entire field is in its band; 0 if there are none.
        unflagged_field: Vec<f64> = array("unflagged_field", "1", [calibrations, families]),
        /// Share of patterns whose objective is in its interval.
        objective: Vec<f64> = array("objective", "1", [objectives, calibrations, families]),
        /// Median half-width of the interval of an objective.
        objective_half_width: Vec<f64> = array("objective_half_width", "mm", [objectives, calibrations, families]),
    }
}
