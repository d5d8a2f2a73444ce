//! Presentation of the artifacts of a stage kind.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::artifacts::{ArtifactReader, RunArtifacts};
use super::drawing::Sheet;
use super::error::ReportError;
use super::html::Page;

/// Draws a figure of an artifact; `None` if there is nothing to draw.
pub type DrawFigure = fn(&ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError>;

/// The figures of each artifact of a kind, with their names.
pub type Figures = &'static [(&'static str, DrawFigure)];

/// Presents the artifacts of a stage kind: as text and JSON at the end of a run, as figures, and on the page of a
/// report.
pub trait Presenter: Sync {
    /// The stage kind.
    fn kind(&self) -> &'static str;

    /// Returns the results of a run.
    ///
    /// # Errors
    /// If an artifact cannot be read or does not have the content of its kind.
    fn results(&self, _: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        Ok(Vec::new())
    }

    /// Returns the main results, the most important line first.
    ///
    /// # Errors
    /// If an artifact cannot be read or does not have the content of its kind.
    fn headlines(&self, _: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        Ok(Vec::new())
    }

    /// Returns the figures of each artifact.
    fn figures(&self) -> Figures {
        &[]
    }

    /// Draws the missing figures of several artifacts together into a folder, and returns the paths of all.
    ///
    /// # Errors
    /// If an artifact cannot be read or a figure cannot be written.
    fn common_figures(&self, _: &RunArtifacts<'_>, _folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
        Ok(Vec::new())
    }

    /// Adds the sections of the page, if there are artifacts.
    ///
    /// # Errors
    /// If an artifact cannot be read or does not have the content of its kind.
    fn section(&self, _: &mut Page, _: &RunArtifacts<'_>) -> Result<(), ReportError> {
        Ok(())
    }
}

/// The results of the artifacts of a kind.
#[derive(Debug, Serialize, Deserialize)]
pub struct Results {
    /// The key in the JSON document of `run`.
    pub key: String,
    /// The value of the key.
    pub value: Value,
    /// Paragraphs for people.
    pub text: Vec<String>,
    /// Warnings, which are also in the text.
    pub warnings: Vec<String>,
}

impl Results {
    /// Creates results without warnings.
    #[must_use]
    pub fn new(key: &str, value: &impl Serialize, text: impl IntoIterator<Item = String>) -> Self {
        Self {
            key: key.to_owned(),
            value: json!(value),
            text: text.into_iter().collect(),
            warnings: Vec::new(),
        }
    }

    /// Adds warnings.
    #[must_use]
    pub fn with_warnings(self, warnings: Vec<String>) -> Self {
        Self { warnings, ..self }
    }
}

/// A main result of a run, on one line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Headline {
    /// The text.
    pub text: String,
    /// Whether it has no warning.
    pub is_good: bool,
}

impl Headline {
    /// Creates a line without a warning.
    #[must_use]
    pub fn good(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            is_good: true,
        }
    }

    /// Creates a line with a warning.
    #[must_use]
    pub fn bad(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            is_good: false,
        }
    }
}
