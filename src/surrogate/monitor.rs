//! Callbacks of a training: progress and checkpoints.

use super::outcome::EpochReport;
use deaflow_base::Stopped;

/// Receives the progress of a training and stores its checkpoints. The default methods do nothing.
pub trait Monitor {
    /// Called after each step with the epoch (from 1), the finished share of the epoch, and the mean loss per example
    /// in the epoch so far.
    fn step(&self, epoch: u32, done: f64, loss: f64) {
        let _ = (epoch, done, loss);
    }

    /// Called after each epoch.
    fn epoch(&self, report: &EpochReport) {
        let _ = report;
    }

    /// Called before the first epoch when the training resumes from a checkpoint, with the number of finished epochs.
    fn resumed(&self, epochs: u32) {
        let _ = epochs;
    }

    /// Returns the last stored checkpoint.
    fn checkpoint(&self) -> Option<Vec<u8>> {
        None
    }

    /// Called after each epoch to store a checkpoint; `state` encodes it.
    ///
    /// # Errors
    /// When the training is to stop here.
    fn store_checkpoint(&self, state: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        let _ = state;
        Ok(())
    }

    /// Called when the stored checkpoint belongs to another training; it is not used.
    fn unusable_checkpoint(&self) {}
}

/// Ignores the progress.
impl Monitor for () {}
