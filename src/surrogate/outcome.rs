//! What a training comes to.

use serde::{Deserialize, Serialize};

use super::metrics::Metrics;
use deaflow_base::Stopped;
use deaflow_pattern::Raster;

/// What an epoch came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpochReport {
    /// Number of the epoch, from 1.
    pub epoch: u32,
    /// Mean loss per example over the epoch, while the weights were changing.
    pub train_loss: f64,
    /// Mean loss per validation example after the epoch; per training example where there is no validation example.
    pub validation_loss: f64,
    /// Root mean square error in mm, over both components at all corners, of the same examples after the epoch.
    pub validation_rmse_mm: f64,
    /// The error by which epochs are judged, mm: that of the validation examples and of the training examples that an epoch shows
    /// more than once, these counted as often as they are shown. Where there are none of either kind it is the one above.
    pub judged_rmse_mm: f64,
    /// Learning rate of the last step.
    pub learning_rate: f64,
}

/// How a training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// After its last epoch.
    Complete,
    /// After as many epochs without a better one as its patience allows.
    Patience,
    /// In this epoch the loss exploded or was no number; an epoch before it is kept.
    Diverged(u32),
}

/// A trained network with the record of its training.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The network as safetensors; [`super::Surrogate::load`] reads it.
    pub weights: Vec<u8>,
    /// One report per epoch that was finished.
    pub curves: Vec<EpochReport>,
    /// Metrics of the kept epoch: for each part of the dataset "all", then the families by name; groups without examples
    /// are left out.
    pub metrics: Vec<Metrics>,
    /// The epoch that was kept: the best on the validation examples, or the last where there are none.
    pub best_epoch: u32,
    /// How it ended.
    pub ending: Ending,
}

/// A training that could not be done.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// Nothing to learn from.
    #[error("there are no training examples")]
    NoExamples,
    /// Examples of several membranes.
    #[error("some examples have {} cells and some {}", .0[0], .0[1])]
    Rasters([Raster; 2]),
    /// Examples with more groups of electrodes than the device has.
    #[error("an example has electrodes of group {}, and groups of the device number {}", .0[1], .0[0])]
    Groups([usize; 2]),
    /// An option out of its range.
    #[error("{name} is {value}; it must be {allowed}")]
    Option {
        /// Which option.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// A network that starts from what is known of the scene was not told it.
    #[error("the network {network} needs the linear response of the scene")]
    NoConstants {
        /// The network.
        network: &'static str,
    },
    /// The loss has exploded or is no number, and no epoch before was better than the untrained network.
    #[error(
        "the training diverged in epoch {epoch}, and no epoch before it was better than the untrained network; a smaller \
         learning rate may help"
    )]
    Diverged {
        /// The epoch.
        epoch: u32,
    },
    /// The network to begin with is none, or another one.
    #[error("the training cannot begin from the model: {0}")]
    Start(String),
    /// It was asked to stop.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// What the numerical library reported.
    #[error("the training failed: {0}")]
    Failed(String),
}

impl From<candle_core::Error> for TrainError {
    fn from(error: candle_core::Error) -> Self {
        Self::Failed(error.to_string())
    }
}
