//! How the artifacts of a stage kind are shown.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::artifacts::{RunArtifacts, Source};
use super::error::ReportError;
use super::headline::Headline;
use super::html::Page;

/// Draws a figure of an artifact into a file; none where there is nothing to draw.
pub type DrawFigure = fn(&Path, &Source<'_>) -> Result<(), ReportError>;

/// Shows the artifacts of a stage kind: in words and JSON at the end of a run, as figures, and on the page of a report.
pub trait Presenter: Sync {
    /// The stage kind.
    fn kind(&self) -> &'static str;

    /// What a run says of its artifacts.
    ///
    /// # Errors
    /// When an artifact cannot be read or does not hold what its kind promises.
    fn results(&self, _: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        Ok(Vec::new())
    }

    /// What matters most of its artifacts, the most important line first.
    ///
    /// # Errors
    /// When an artifact cannot be read or does not hold what its kind promises.
    fn headlines(&self, _: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        Ok(Vec::new())
    }

    /// The figures of each artifact, by their names.
    fn figures(&self) -> &'static [(&'static str, DrawFigure)] {
        &[]
    }

    /// Draws the figures of several artifacts together into a folder, those that are not there yet, and returns all paths.
    ///
    /// # Errors
    /// When an artifact cannot be read or a figure not be written.
    fn common_figures(&self, _: &RunArtifacts<'_>, _folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
        Ok(Vec::new())
    }

    /// Adds what the page says of its artifacts: nothing where there are none.
    ///
    /// # Errors
    /// When an artifact cannot be read or does not hold what its kind promises.
    fn section(&self, _: &mut Page, _: &RunArtifacts<'_>) -> Result<(), ReportError> {
        Ok(())
    }
}

/// What a run says of the artifacts of a kind.
#[derive(Debug, Serialize, Deserialize)]
pub struct Results {
    /// The key in the JSON document of `run`.
    pub key: String,
    /// What stands there.
    pub value: Value,
    /// For people: paragraphs.
    pub text: Vec<String>,
    /// What a user should know; the text says it too.
    pub warnings: Vec<String>,
}
