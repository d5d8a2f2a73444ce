//! What the report of a run begins with: its best design or its front, or else its main result, as a sentence and a
//! picture.

use super::artifacts::{ArtifactReader, RunArtifacts};
use super::designs::designs;
use super::drawing::{Sheet, image};
use super::error::ReportError;
use super::headline::headlines;
use super::kinds::by_section;
use super::page::best::Best;

/// The sentence that a report begins with.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Opening {
    /// The displacement of the best design or the ends of the front, or else the main result; empty without results.
    pub sentence: String,
    /// What the best design or the front is for, and how sure it is; empty without a design.
    pub facts: Vec<String>,
}

impl Opening {
    /// Reads it from the artifacts of a run.
    ///
    /// # Errors
    /// If an artifact cannot be read or does not have the content of its kind.
    pub fn of(run: &RunArtifacts<'_>) -> Result<Self, ReportError> {
        let all = designs(run, &run.superseded())?;
        if let Some(best) = Best::of(&all) {
            return Ok(Self {
                sentence: best.sentence(),
                facts: best.facts(&all),
            });
        }
        let (lines, _) = headlines(run)?;
        let sentence = lines.into_iter().next().map(|line| line.text);
        Ok(Self {
            sentence: sentence.unwrap_or_default(),
            facts: Vec::new(),
        })
    }
}

/// Draws the best design of a run or the ends of its front, or else the first figure of its report, as an SVG document;
/// `None` if there is nothing to draw.
///
/// # Errors
/// If an artifact cannot be read or does not have the content of its kind.
pub fn opening_picture(run: &RunArtifacts<'_>) -> Result<Option<String>, ReportError> {
    let document = |(sheet, description): (Sheet, String)| image(sheet.size, &sheet.svg(&description));
    if let Some(best) = Best::of(&designs(run, &run.superseded())?) {
        return Ok(Some(document(best.picture())));
    }
    Ok(first_figure(run)?.map(document))
}

/// Draws the first figure of a report, and describes it.
fn first_figure(run: &RunArtifacts<'_>) -> Result<Option<(Sheet, String)>, ReportError> {
    for presenter in by_section() {
        for stage in run.stages.iter().filter(|stage| stage.kind == presenter.kind()) {
            let artifact = run.store.artifact(&stage.digest)?;
            let reader = ArtifactReader {
                stage,
                artifact: &artifact,
                run: run.stages,
            };
            for (name, draw) in presenter.figures() {
                if let Some(sheet) = draw(&reader)? {
                    return Ok(Some((sheet, format!("{} of {}", name, stage.stage))));
                }
            }
        }
    }
    Ok(None)
}
