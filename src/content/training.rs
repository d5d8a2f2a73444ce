//! The artifact of a train stage.

use super::attribute::Lines;
use super::dropped::DroppedRows;
use super::macros::arrays;
use deaflow_scene::Scene;

/// The family name of metrics over all families.
pub const ALL_FAMILIES: &str = "all";

arrays! {
    /// A trained network.
    pub struct Training, TrainingView {
        /// The model as the bytes of a safetensors file.
        weights: Vec<u8> = array("weights", "1", [byte]),
        /// Epoch of the kept weights, from 1.
        best_epoch: [u64; 1] = array("best_epoch", "1", [single]),
        /// Samples left out because they have no stable solution.
        unstable: [u64; 1] = array("counts/unstable", "1", [single]),
        /// The learning curves.
        curves: Curves = group("curves"),
        /// Labels that were left out.
        left_out: LeftOutLabels = group("left_out"),
        /// Errors of the network.
        metrics: Metrics = group("metrics"),
        /// The network.
        network: String = attribute("network"),
        /// How the training ended: `complete`, `patience` or `diverged`.
        ending: String = attribute("ending"),
        /// Rows that `without` dropped.
        dropped: Option<DroppedRows> = group("dropped"),
        /// What `without` dropped, one line per audit or list of marked rows.
        without: Option<Lines> = attribute("without"),
        /// The scene of the examples.
        scene: Scene = attribute("scene"),
        /// Warnings, one per line.
        warnings: Option<Lines> = attribute("warnings"),
    }
}

arrays! {
    /// Learning curves by epoch.
    #[derive(Default)]
    pub struct Curves, CurvesView {
        /// RMSE per component that selects the best epoch, if it includes verified designs.
        judged_rmse: Option<Vec<f64>> = array("judged_rmse", "mm", [epoch]),
        /// Training loss of each epoch.
        train_loss: Vec<f64> = array("train_loss", "1", [epoch]),
        /// Validation loss of each epoch.
        validation_loss: Vec<f64> = array("validation_loss", "1", [epoch]),
        /// Validation RMSE per component of each epoch.
        validation_rmse: Vec<f64> = array("validation_rmse", "mm", [epoch]),
        /// Learning rate at the end of each epoch.
        learning_rate: Vec<f64> = array("learning_rate", "1", [epoch]),
    }
}

arrays! {
    /// Labels that were left out.
    #[derive(Default)]
    pub struct LeftOutLabels, LeftOutLabelsView {
        /// Input with the label, from 0.
        input: Vec<u64> = array("input", "1", [label]),
        /// Its row in that input, from 0.
        row: Vec<u64> = array("row", "1", [label]),
        /// The invalid displacement; 0 if it is not a number.
        displacement: Vec<f64> = array("displacement", "mm", [label]),
        /// The reason.
        why: Vec<String> = array("why", "", [label]),
    }
}

arrays! {
    /// Errors of a network by family and split.
    #[derive(Default)]
    pub struct Metrics, MetricsView {
        /// Family of the metrics; `all` for all families.
        family: Vec<String> = array("family", "", [metric]),
        /// Split of the metrics.
        split: Vec<String> = array("split", "", [metric]),
        /// Number of samples of the metrics.
        samples: Vec<u64> = array("samples", "1", [metric]),
        /// Root mean square error per component.
        rmse: Vec<f64> = array("rmse", "mm", [metric]),
        /// Coefficient of determination.
        r2: Vec<f64> = array("r2", "1", [metric]),
        /// Largest absolute error of a component.
        max_error: Vec<f64> = array("max_error", "mm", [metric]),
    }
}
