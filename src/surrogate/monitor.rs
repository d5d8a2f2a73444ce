//! Who follows a training.

use super::outcome::EpochReport;
use deaflow_base::Stopped;

/// Follows a training, and keeps what it needs to be gone on with. All that is left out does nothing.
pub trait Monitor {
    /// Within an epoch, after each step: the number of the epoch from 1, which part of it is done, and the mean loss per example
    /// in it so far.
    fn step(&self, epoch: u32, done: f64, loss: f64) {
        let _ = (epoch, done, loss);
    }

    /// After each epoch.
    fn epoch(&self, report: &EpochReport) {
        let _ = report;
    }

    /// Before the first epoch, when an earlier training with the same examples and options is gone on with: how many epochs it
    /// has done.
    fn resumed(&self, epochs: u32) {
        let _ = epochs;
    }

    /// The state that was last kept, if any.
    fn kept(&self) -> Option<Vec<u8>> {
        None
    }

    /// After each epoch: the state, for whoever wants to keep it. It is made when `state` is called.
    ///
    /// # Errors
    /// When the training is to stop here.
    fn keep(&self, state: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        let _ = state;
        Ok(())
    }

    /// A state that was kept, but is not one of this training: it is not used.
    fn unusable(&self) {}
}

/// Nobody.
impl Monitor for () {}
