//! What can go wrong with a report.

use std::path::PathBuf;

use super::drawing::FigureError;
use deaflow_base::{ArtifactId, OutputError};
use deaflow_store::StoreError;

/// A figure or summary that could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The artifact cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The artifact does not hold what its kind promises.
    #[error("artifact {digest} of stage `{stage}`: {reason}", digest = digest.short())]
    Content {
        /// Name of the stage.
        stage: String,
        /// Its artifact.
        digest: ArtifactId,
        /// What is wrong.
        reason: String,
    },
    /// A file of a report cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The folder has the report of another pipeline.
    #[error("{folder} has the report of the pipeline {pipeline}, which would be lost", folder = folder.display())]
    Other {
        /// The folder.
        folder: PathBuf,
        /// Whose report is there.
        pipeline: String,
    },
    /// A file of an earlier report cannot be replaced.
    #[error("cannot replace {path}: {source}", path = path.display())]
    Replace {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The drawing failed.
    #[error("stage `{stage}`: {source}")]
    Figure {
        /// Name of the stage.
        stage: String,
        /// Why.
        source: FigureError,
    },
    /// The folder of the figures cannot be made.
    #[error("cannot make the folder {path}: {source}", path = path.display())]
    Folder {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}
