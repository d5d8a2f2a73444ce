//! Results and errors of a training.

use serde::{Deserialize, Serialize};

use super::metrics::Metrics;
use deaflow_base::Stopped;
use deaflow_pattern::Raster;

/// Result of an epoch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpochReport {
    /// Number of the epoch, from 1.
    pub epoch: u32,
    /// Mean loss per example during the epoch.
    pub train_loss: f64,
    /// Mean loss per validation example after the epoch (per training example where there are no validation examples).
    pub validation_loss: f64,
    /// Root mean square error in mm of the same examples after the epoch, over both components at all corners.
    pub validation_rmse_mm: f64,
    /// Error that selects the best epoch, mm. It also includes the training examples that an epoch repeats, weighted by
    /// their repeats; without such examples or without validation examples it equals `validation_rmse_mm`.
    pub selection_rmse_mm: f64,
    /// Learning rate of the last step.
    pub learning_rate: f64,
}

/// Reason for which a training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The last epoch was reached.
    Complete,
    /// Early stopping.
    Patience,
    /// The loss of this epoch exploded or was not finite; the best earlier epoch is kept.
    Diverged(u32),
}

/// A trained network and its training history.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The network as safetensors; [`super::Surrogate::load`] reads it.
    pub weights: Vec<u8>,
    /// One report per finished epoch.
    pub curves: Vec<EpochReport>,
    /// Metrics of the best epoch, for each split "all", then the families by name. Groups without examples are omitted.
    pub metrics: Vec<Metrics>,
    /// The epoch whose weights are kept: the best one, or the last where there are no validation examples.
    pub best_epoch: u32,
    /// Reason for which the training ended.
    pub ending: Ending,
}

/// Error of a training.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// There are no training examples.
    #[error("there are no training examples")]
    NoExamples,
    /// The examples differ in their cells.
    #[error("examples differ in size: some have {} cells, some {}", .0[0], .0[1])]
    Rasters([Raster; 2]),
    /// An example has more electrode groups than the device.
    #[error("an example uses electrode group {}, but the device has groups 1 to {}", .0[1], .0[0])]
    Groups([usize; 2]),
    /// An option is out of range.
    #[error("{name} is {value}; it must be {allowed}")]
    Option {
        /// Which option.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// The network needs the constants of the scene.
    #[error("the network {network} needs the linear response of the scene")]
    NoConstants {
        /// The network.
        network: &'static str,
    },
    /// The loss exploded or is not finite, and no earlier epoch improved on the untrained network.
    #[error(
        "training diverged in epoch {epoch} and no earlier epoch improved on the untrained network; try a smaller \
         learning rate"
    )]
    Diverged {
        /// The epoch.
        epoch: u32,
    },
    /// Training cannot start from the given model.
    #[error("cannot start training from the model: {0}")]
    WarmStart(String),
    /// The training was stopped.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The numerical library reported an error.
    #[error("training failed: {0}")]
    Failed(String),
}

impl From<candle_core::Error> for TrainError {
    fn from(error: candle_core::Error) -> Self {
        Self::Failed(error.to_string())
    }
}
