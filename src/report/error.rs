//! Errors of reports.

use std::path::PathBuf;

use super::drawing::FigureError;
use deaflow_base::{ArtifactId, OutputError};
use deaflow_store::StoreError;

/// A figure or summary could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The artifact cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The artifact does not have the content of its kind.
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
    #[error("{} has the report of another pipeline, {pipeline}, which would be overwritten", folder.display())]
    Other {
        /// The folder.
        folder: PathBuf,
        /// The pipeline of that report.
        pipeline: String,
    },
    /// A file of an earlier report cannot be replaced or removed.
    #[error("cannot replace {path}: {source}", path = path.display())]
    Replace {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// A figure cannot be drawn.
    #[error("stage `{stage}`: {source}")]
    Figure {
        /// Name of the stage.
        stage: String,
        /// The error.
        source: FigureError,
    },
    /// A folder cannot be created.
    #[error("cannot create the folder {path}: {source}", path = path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
}

impl ReportError {
    /// Whether a file or folder of a report or figure cannot be written, while the results themselves can be read.
    #[must_use]
    pub fn is_of_writing(&self) -> bool {
        match self {
            Self::Output(_) | Self::Replace { .. } | Self::Folder { .. } => true,
            Self::Figure { source, .. } => matches!(source, FigureError::Output(_)),
            Self::Store(_) | Self::Content { .. } | Self::Other { .. } => false,
        }
    }
}
