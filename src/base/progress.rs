//! How work in any room tells how far it has come.

/// A piece of work was asked to stop, and what it has come to is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped; its progress is saved")]
pub struct Stopped;

/// Receives the progress of a piece of work.
pub trait Progress: Sync {
    /// `steps` more are done.
    fn advance(&self, steps: u64);
    /// Of the step under way this part is done, between 0 and 1: what takes long has a pace before its first step is over.
    fn part(&self, done: f64) {
        let _ = done;
    }
    /// A short text beside the bar ("loss 0.0123").
    fn note(&self, text: &str);
    /// `steps` were done before this piece of work began: they say nothing of its pace.
    fn resume(&self, steps: u64) {
        self.advance(steps);
    }
}
