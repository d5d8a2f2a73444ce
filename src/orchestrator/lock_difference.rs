//! Differences between a pipeline and its lock file.

/// A difference between a pipeline, or its artifacts, and its lock file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LockDifference {
    /// A stage is not in the lock file.
    #[error("stage `{0}` is not in the lock file")]
    Added(String),
    /// A stage is not in the pipeline.
    #[error("stage `{0}` is in the lock file, but not in the pipeline")]
    Dropped(String),
    /// The action of a stage differs.
    #[error("stage `{stage}` differs from the lock file: {why}")]
    Key {
        /// The stage.
        stage: String,
        /// What has changed, as far as known.
        why: String,
    },
    /// The artifact of a stage differs although its action is the same.
    #[error("stage `{stage}` made artifact {found}, but the lock file has {locked}{why}")]
    Artifact {
        /// The stage.
        stage: String,
        /// Its artifact.
        found: String,
        /// The artifact in the lock file.
        locked: String,
        /// A possible reason.
        why: String,
    },
}
