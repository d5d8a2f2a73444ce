//! The report of a pipeline as one page: what was found at the top, then everything that it stands on.

mod cards;
mod costs;
mod dag;
mod designs;
mod layout;
mod scene;

use super::artifacts::RunArtifacts;
use super::designs::{Design, Extreme, Found};
use super::error::ReportError;
use super::format::{bytes, counted, gain, percent, seconds};
use super::history::History;
use super::html::Page;
use super::kinds::by_section;
use super::summary::TRUSTED;

/// The page of a pipeline.
///
/// # Errors
/// When an artifact cannot be read or does not hold what its kind promises.
pub fn report_page(run: &RunArtifacts<'_>, history: &History, designs: &[Design]) -> Result<String, ReportError> {
    let mut page = Page::new(&history.pipeline);
    head(&mut page, history, designs);
    dag::section(&mut page, history);
    designs::section(&mut page, designs);
    designs::agreement(&mut page, designs);
    for presenter in by_section() {
        presenter.section(&mut page, run)?;
    }
    scene::section(&mut page, run, history)?;
    costs::section(&mut page, history);
    costs::provenance(&mut page, history);
    Ok(page.finish())
}

/// Title, what is missing, and the numbers that matter.
fn head(page: &mut Page, history: &History, designs: &[Design]) {
    page.lead(&format!(
        "Report of the pipeline {}: {} from {}.",
        history.pipeline,
        counted(history.stages.len(), "stage", "stages"),
        history.path
    ));
    let missing: Vec<&str> = history.missing().iter().map(|stage| stage.name.as_str()).collect();
    if !missing.is_empty() {
        page.notice(&[
            format!(
                "This report is not complete: {} of {} stages are not built.",
                missing.len(),
                history.stages.len()
            ),
            format!(
                "Missing: {}. Build them: deaflow run {}",
                missing.join(", "),
                history.path
            ),
        ]);
    }
    let found = Found::of(designs);
    let wrong = found.prediction_error.as_ref().filter(|error| error.value > TRUSTED);
    if let Some(error) = wrong {
        page.notice(&[format!(
            "Predicted and simulated differ by up to {} ({}): what judged these designs is not to be trusted there.",
            percent(error.value, 1),
            error.design
        )]);
    }
    let mut tiles = of_designs(&found);
    let took: f64 = history
        .stages
        .iter()
        .filter_map(|s| s.origin.as_ref())
        .map(costs::took)
        .sum();
    let size: u64 = history.stages.iter().map(|stage| stage.bytes).sum();
    tiles.push((seconds(took), "to build all stages once".to_owned()));
    tiles.push((bytes(size), "in the store".to_owned()));
    page.tiles(&tiles);
}

fn of_designs(found: &Found) -> Vec<(String, String)> {
    if found.designs == 0 {
        return Vec::new();
    }
    let mut tiles = vec![(
        found.targets.to_string(),
        format!(
            "{}, {} of {} designs verified by FEM",
            if found.targets == 1 { "target" } else { "targets" },
            found.simulated,
            found.designs
        ),
    )];
    let ratio = |extreme: &Extreme, who: &str| {
        (
            percent(extreme.value, 2),
            format!("{who}, at the least ({})", extreme.design),
        )
    };
    tiles.extend(
        found
            .refined_to_optimum
            .iter()
            .map(|e| ratio(e, "of the optimum reached by refined designs")),
    );
    tiles.extend(
        found
            .ga_to_optimum
            .iter()
            .map(|e| ratio(e, "of the optimum reached by the genetic algorithm")),
    );
    tiles.extend(found.prediction_error.iter().map(|e| {
        let what = format!("between predicted and simulated, at the most ({})", e.design);
        (percent(e.value, 2), what)
    }));
    let gained = |share: &f64, area: &str| {
        (
            gain(*share, 1),
            format!("over the intuitive design at {area} area, median of the targets"),
        )
    };
    tiles.extend(found.gain_own_area.iter().map(|share| gained(share, "its own")));
    tiles.extend(found.gain_equal_area.iter().map(|share| gained(share, "equal")));
    if found.not_met > 0 {
        let what = match found.not_met {
            1 => "design does not meet its constraints",
            _ => "designs do not meet their constraints",
        };
        tiles.push((found.not_met.to_string(), what.to_owned()));
    }
    tiles
}
