//! The artifacts of a run, and how they are read for people.

use std::path::Path;

use super::drawing::FigureError;
use super::error::ReportError;
use deaflow_base::ArtifactId;
use deaflow_content::ContentError;
use deaflow_orchestrator::Rounds;
use deaflow_store::{Artifact, Store};

/// What one stage of a run made.
#[derive(Clone, Debug)]
pub struct Made {
    /// Name of the stage.
    pub stage: String,
    /// Its kind.
    pub kind: String,
    /// Its artifact.
    pub digest: ArtifactId,
}

/// What a run of a pipeline made.
pub struct RunArtifacts<'a> {
    /// Where its artifacts are.
    pub store: &'a Store,
    /// File of the pipeline.
    pub file: &'a Path,
    /// Its stages.
    pub made: &'a [Made],
    /// Stages that are done in rounds.
    pub rounds: &'a [Rounds],
}

impl RunArtifacts<'_> {
    /// What `read` makes of every artifact of a kind.
    ///
    /// # Errors
    /// When an artifact cannot be read, or `read` fails.
    pub fn each<T>(
        &self,
        kind: &str,
        read: impl Fn(&Source<'_>) -> Result<T, ReportError>,
    ) -> Result<Vec<T>, ReportError> {
        each(self.store, self.made, kind, read)
    }
}

/// An artifact with the stage that made it, for messages.
pub struct Source<'a> {
    /// The stage.
    pub stage: &'a Made,
    /// Its artifact.
    pub artifact: &'a Artifact,
    /// All that the run made: whose names artifacts go by.
    pub run: &'a [Made],
}

/// What `read` makes of every artifact of a kind in a run.
///
/// # Errors
/// When an artifact cannot be read, or `read` fails.
pub fn each<T>(
    store: &Store,
    made: &[Made],
    kind: &str,
    read: impl Fn(&Source<'_>) -> Result<T, ReportError>,
) -> Result<Vec<T>, ReportError> {
    let of_kind = made.iter().filter(|stage| stage.kind == kind);
    of_kind
        .map(|stage| {
            let artifact = store.artifact(&stage.digest)?;
            read(&Source {
                stage,
                artifact: &artifact,
                run: made,
            })
        })
        .collect()
}

impl Source<'_> {
    /// The error that the artifact does not hold what its kind promises.
    pub fn wrong(&self, reason: impl Into<String>) -> ReportError {
        ReportError::Content {
            stage: self.stage.stage.clone(),
            digest: self.stage.digest,
            reason: reason.into(),
        }
    }

    /// What was read of the artifact.
    ///
    /// # Errors
    /// Those of the reading.
    pub fn of<T>(&self, read: Result<T, ContentError>) -> Result<T, ReportError> {
        read.map_err(|error| match error {
            ContentError::Store(error) => ReportError::Store(error),
            ContentError::Fault { fault, .. } => self.wrong(fault.to_string()),
        })
    }

    /// What was drawn of the artifact.
    ///
    /// # Errors
    /// Those of the drawing.
    pub fn drawn<T>(&self, outcome: Result<T, FigureError>) -> Result<T, ReportError> {
        outcome.map_err(|source| ReportError::Figure {
            stage: self.stage.stage.clone(),
            source,
        })
    }
}
