//! Reports the progress of long work.

/// A request stopped the work, and its progress is saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped; its progress is saved")]
pub struct Stopped;

/// Receives the progress of some work.
pub trait Progress: Sync {
    /// Reports that `steps` more steps are done.
    fn advance(&self, steps: u64);
    /// Reports the fraction of the current step that is done, from 0 to 1, so that a long first step has an estimated
    /// time.
    fn part(&self, _done: f64) {}
    /// Shows a short text next to the progress bar, such as "loss 0.0123".
    fn note(&self, text: &str);
    /// Reports that `steps` steps were done before this work began, so that they do not count for its speed.
    fn resume(&self, steps: u64) {
        self.advance(steps);
    }
}
