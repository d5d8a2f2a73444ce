//! What the report of a run begins with: its best design or its front, or else its main result, as a sentence and a
//! picture.

use maud::{Markup, PreEscaped, html};

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

/// A picture, as an SVG document.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpeningPicture {
    /// The document.
    pub svg: String,
    /// What it shows, and how large displacements are drawn.
    pub caption: String,
}

/// Draws the best design of a run or the ends of its front, or else the first figure of its report; `None` if there is
/// nothing to draw.
///
/// # Errors
/// If an artifact cannot be read or does not have the content of its kind.
pub fn opening_picture(run: &RunArtifacts<'_>) -> Result<Option<OpeningPicture>, ReportError> {
    let picture = |(sheet, description, caption): (Sheet, String, String)| OpeningPicture {
        svg: image(sheet.size, &sheet.svg(&description)),
        caption,
    };
    if let Some(best) = Best::of(&designs(run, &run.superseded())?) {
        return Ok(Some(picture(best.picture())));
    }
    let first = drawn(run, &|_| true, 1)?.pop();
    Ok(first.map(|(sheet, description)| picture((sheet, description.clone(), description))))
}

/// The figures that the sections of pages lack: patterns of designs, and the findings of audits.
const BESIDE: [&str; 3] = ["best", "verification", "audit"];

/// Draws the figures of a run that the sections of its page lack, with their descriptions. Their texts are smaller than
/// in files: fonts of browsers are wider.
///
/// # Errors
/// If an artifact cannot be read or does not have the content of its kind.
pub fn figures_beside(run: &RunArtifacts<'_>) -> Result<Vec<(String, Markup)>, ReportError> {
    let found = drawn(run, &|name| BESIDE.contains(&name), usize::MAX)?.into_iter();
    let figure = |(sheet, description): (Sheet, String)| {
        let drawing = html! {
            style { (PreEscaped(".beside text { font-size: 10px }")) }
            div.beside { (sheet.svg(&description)) }
        };
        (description, drawing)
    };
    Ok(found.map(figure).collect())
}

/// Draws the first figures of a report with some names, and describes them.
fn drawn(
    run: &RunArtifacts<'_>,
    is_wanted: &dyn Fn(&str) -> bool,
    most: usize,
) -> Result<Vec<(Sheet, String)>, ReportError> {
    let mut found = Vec::new();
    for presenter in by_section() {
        for stage in run.stages.iter().filter(|stage| stage.kind == presenter.kind()) {
            let artifact = run.store.artifact(&stage.digest)?;
            let reader = ArtifactReader {
                stage,
                artifact: &artifact,
                run: run.stages,
            };
            for (name, draw) in presenter.figures().iter().filter(|(name, _)| is_wanted(name)) {
                if found.len() == most {
                    return Ok(found);
                }
                let sheet = draw(&reader)?;
                found.extend(sheet.map(|sheet| (sheet, format!("{} of {}", name, stage.stage))));
            }
        }
    }
    Ok(found)
}
