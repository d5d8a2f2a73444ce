//! Errors of runs and plans.

use super::lock_difference::LockDifference;
use deaflow_base::InputError;
use deaflow_store::StoreError;

/// A run or a plan is not possible.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// There is no stage of the requested name.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The store reported an error that belongs to no stage.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The pipeline differs from its lock file.
    #[error("the pipeline differs from its lock file: {}", joined(.0))]
    Locked(Vec<LockDifference>),
}

fn joined(differences: &[LockDifference]) -> String {
    let texts: Vec<String> = differences.iter().map(ToString::to_string).collect();
    texts.join("; ")
}
