//! The artifacts of a run, and how a report reads them.

use std::path::Path;

use super::drawing::FigureError;
use super::error::ReportError;
use deaflow_base::ArtifactId;
use deaflow_orchestrator::Rounds;
use deaflow_store::{Artifact, Store, StoreError};

/// The artifact of a stage.
#[derive(Clone, Debug)]
pub struct StageArtifact {
    /// Name of the stage.
    pub stage: String,
    /// Its kind.
    pub kind: String,
    /// Its artifact.
    pub digest: ArtifactId,
}

/// The artifacts of a run of a pipeline.
pub struct RunArtifacts<'a> {
    /// The store of the artifacts.
    pub store: &'a Store,
    /// File of the pipeline.
    pub file: &'a Path,
    /// Its stages that have an artifact.
    pub stages: &'a [StageArtifact],
    /// Stages that are repeated in rounds.
    pub rounds: &'a [Rounds],
}

impl RunArtifacts<'_> {
    /// Calls `read` for every artifact of a kind.
    ///
    /// # Errors
    /// If an artifact cannot be read, or `read` fails.
    pub fn each<T>(
        &self,
        kind: &str,
        read: impl Fn(&ArtifactReader<'_>) -> Result<T, ReportError>,
    ) -> Result<Vec<T>, ReportError> {
        let of_kind = self.stages.iter().filter(|stage| stage.kind == kind);
        of_kind
            .map(|stage| {
                let artifact = self.store.artifact(&stage.digest)?;
                read(&ArtifactReader {
                    stage,
                    artifact: &artifact,
                    run: self.stages,
                })
            })
            .collect()
    }

    /// Returns the stages of earlier rounds, of which a later round is built.
    #[must_use]
    pub fn superseded(&self) -> Vec<&str> {
        let is_built = |name: &&String| self.stages.iter().any(|made| made.stage == **name);
        let earlier = self.rounds.iter().flat_map(|rounds| {
            let done: Vec<&String> = rounds.stages.iter().filter(is_built).collect();
            let last = done.len().saturating_sub(1);
            done.into_iter().take(last)
        });
        earlier.map(String::as_str).collect()
    }
}

/// An artifact with its stage, which error messages name.
pub struct ArtifactReader<'a> {
    /// The stage.
    pub stage: &'a StageArtifact,
    /// Its artifact.
    pub artifact: &'a Artifact,
    /// All artifacts of the run, whose stages give artifacts their names.
    pub run: &'a [StageArtifact],
}

impl ArtifactReader<'_> {
    /// Returns the error that the artifact does not have the content of its kind.
    pub fn wrong(&self, reason: impl Into<String>) -> ReportError {
        ReportError::Content {
            stage: self.stage.stage.clone(),
            digest: self.stage.digest,
            reason: reason.into(),
        }
    }

    /// Adds the stage to the error of reading.
    ///
    /// # Errors
    /// The error of reading.
    pub fn of<T>(&self, read: Result<T, StoreError>) -> Result<T, ReportError> {
        read.map_err(|error| match error {
            StoreError::Content { source, .. } => self.wrong(source.to_string()),
            error => ReportError::Store(error),
        })
    }

    /// Adds the stage to the error of drawing.
    ///
    /// # Errors
    /// The error of drawing.
    pub fn drawn<T>(&self, outcome: Result<T, FigureError>) -> Result<T, ReportError> {
        outcome.map_err(|source| ReportError::Figure {
            stage: self.stage.stage.clone(),
            source,
        })
    }
}
