//! How a pipeline, or what it made, differs from its lock file.

/// One way in which a pipeline, or what it made, is not what its lock file says.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LockDifference {
    /// The lock file does not have the stage.
    #[error("stage `{0}` is not in the lock file")]
    Added(String),
    /// The pipeline does not have the stage.
    #[error("stage `{0}` is in the lock file only")]
    Dropped(String),
    /// The stage would do something else.
    #[error("stage `{stage}` is another action than the lock file's: {why}")]
    Key {
        /// The stage.
        stage: String,
        /// What has changed, as far as it is known.
        why: String,
    },
    /// The stage did the same and made something else.
    #[error("stage `{stage}` made {found}, the lock file says {locked}{why}")]
    Artifact {
        /// The stage.
        stage: String,
        /// What it made.
        found: String,
        /// What the lock file says.
        locked: String,
        /// A likely reason.
        why: String,
    },
}
