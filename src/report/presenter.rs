//! How the artifacts of each stage kind are shown: one presenter for each, in one table.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::artifacts::{RunArtifacts, Source};
use super::error::ReportError;
use super::html::Page;
use super::kinds::{accuracy, audit, balance, design, evaluate, solve, train, verify};

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
pub struct Results {
    /// The key in the JSON document of `run`.
    pub key: &'static str,
    /// What stands there.
    pub value: Value,
    /// For people: paragraphs.
    pub text: Vec<String>,
    /// What a user should know; the text says it too.
    pub warnings: Vec<String>,
}

/// All presenters, in the order of what they say at the end of a run.
pub const PRESENTERS: [&dyn Presenter; 8] = [
    &evaluate::Evaluate,
    &design::Design,
    &verify::Verify,
    &train::Train,
    &audit::Audit,
    &balance::Balance,
    &solve::Solve,
    &accuracy::Accuracy,
];

/// The kinds that have sections of a page, in the order of these; kinds that are not among them come last.
const PAGE_ORDER: [&str; 7] = ["verify", "design", "audit", "balance", "solve", "train", "evaluate"];

/// All presenters, in the order of their sections.
pub fn by_section() -> Vec<&'static dyn Presenter> {
    let place = |presenter: &&dyn Presenter| PAGE_ORDER.iter().position(|kind| *kind == presenter.kind());
    let mut presenters = PRESENTERS.to_vec();
    presenters.sort_by_key(|presenter| place(presenter).unwrap_or(PAGE_ORDER.len()));
    presenters
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_one_presenter_and_one_place_on_the_page() {
        let mut kinds = PRESENTERS.map(Presenter::kind).to_vec();
        kinds.sort_unstable();
        kinds.dedup();
        assert_eq!(kinds.len(), PRESENTERS.len());
        assert!(PAGE_ORDER.iter().all(|kind| kinds.contains(kind)));
        assert_eq!(by_section()[0].kind(), "verify");
        assert_eq!(by_section()[7].kind(), "accuracy");
    }
}
