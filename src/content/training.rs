//! The artifact of a train stage.

use super::attribute::Lines;
use super::macros::arrays;
use deaflow_scene::Scene;

/// The family under which all families are measured together.
pub const ALL_FAMILIES: &str = "all";

arrays! {
    /// A trained network.
    pub struct Training, TrainingView {
        /// The model as the bytes of a safetensors file.
        weights: Vec<u8> = array("weights", "1", [byte]),
        /// Epoch whose weights are kept, from 1.
        best_epoch: [u64; 1] = array("best_epoch", "1", [single]),
        /// Samples left out because they have no stable solution.
        unstable: [u64; 1] = array("counts/unstable", "1", [single]),
        /// How the training went.
        curves: Curves = group("curves"),
        /// Labels that nothing was learnt from.
        left_out: LeftOutLabels = group("left_out"),
        /// Errors of the network.
        metrics: Metrics = group("metrics"),
        /// The network.
        network: String = attribute("network"),
        /// How the training ended: `complete`, `patience` or `diverged`.
        ending: String = attribute("ending"),
        /// The scene of the examples.
        scene: Scene = attribute("scene"),
        /// What a user should know, one to a line.
        warnings: Option<Lines> = attribute("warnings"),
    }
}

arrays! {
    /// How a training went, epoch by epoch.
    #[derive(Default)]
    pub struct Curves, CurvesView {
        /// RMSE per component by which epochs are judged: with verified designs.
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
        /// Input that a label left out stands in, from 0.
        input: Vec<u64> = array("input", "1", [label]),
        /// Its row in that input, from 0.
        row: Vec<u64> = array("row", "1", [label]),
        /// The displacement that shows it; 0 where it is not a number.
        displacement: Vec<f64> = array("displacement", "mm", [label]),
        /// What is wrong with it.
        why: Vec<String> = array("why", "", [label]),
    }
}

arrays! {
    /// Errors of a network by family and part of the dataset.
    #[derive(Default)]
    pub struct Metrics, MetricsView {
        /// Family that the metrics are over; `all` for all together.
        family: Vec<String> = array("family", "", [metric]),
        /// Split that the metrics are over.
        split: Vec<String> = array("split", "", [metric]),
        /// Samples that the metrics are over.
        samples: Vec<u64> = array("samples", "1", [metric]),
        /// Root mean square error per component.
        rmse: Vec<f64> = array("rmse", "mm", [metric]),
        /// Coefficient of determination.
        r2: Vec<f64> = array("r2", "1", [metric]),
        /// Largest absolute error of a component.
        max_error: Vec<f64> = array("max_error", "mm", [metric]),
    }
}
