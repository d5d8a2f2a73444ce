//! The report of a pipeline as one page: what was found at the top, then everything that it stands on.

mod accuracy;
mod cards;
mod costs;
mod dag;
mod dataset;
mod designs;
mod evaluation;
mod layout;
mod rounds;
mod scene;
mod search;
mod training;

use super::course::Course;
use super::designs::{Design, Extreme, Found};
use super::format::{bytes, counted, gain, percent, seconds};
use super::gather::{Made, ReportError};
use super::html::Page;
use super::summary::TRUSTED;
use super::training::trainings;
use crate::store::Store;

/// The page of a pipeline.
///
/// # Errors
/// When an artifact cannot be read or does not hold what its kind promises.
pub fn report_page(store: &Store, course: &Course, designs: &[Design]) -> Result<String, ReportError> {
    let made = course.made();
    let mut page = Page::new(&course.pipeline);
    head(&mut page, course, designs);
    dag::section(&mut page, course);
    designs::section(&mut page, designs);
    designs::agreement(&mut page, designs);
    rounds::section(&mut page, store, course)?;
    search::section(&mut page, store, &made)?;
    dataset::section(&mut page, store, &made)?;
    training::section(&mut page, store, &made)?;
    evaluation::section(&mut page, store, &made)?;
    accuracy::section(&mut page, store, &made)?;
    scene::section(&mut page, store, course, &others(store, &made)?)?;
    costs::section(&mut page, course);
    costs::provenance(&mut page, course);
    Ok(page.finish())
}

/// Title, what is missing, and the numbers that matter.
fn head(page: &mut Page, course: &Course, designs: &[Design]) {
    page.lead(&format!(
        "Report of the pipeline {}: {} from {}.",
        course.pipeline,
        counted(course.stages.len(), "stage", "stages"),
        course.path
    ));
    let missing: Vec<&str> = course.missing().iter().map(|stage| stage.name.as_str()).collect();
    if !missing.is_empty() {
        page.notice(&[
            format!(
                "This report is not complete: {} of {} stages are not built.",
                missing.len(),
                course.stages.len()
            ),
            format!(
                "Missing: {}. Build them: deaflow run {}",
                missing.join(", "),
                course.path
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
    let took: f64 = course
        .stages
        .iter()
        .filter_map(|s| s.origin.as_ref())
        .map(costs::took)
        .sum();
    let size: u64 = course.stages.iter().map(|stage| stage.bytes).sum();
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

/// What stages warn of beside effects that were left out.
fn others(store: &Store, made: &[Made]) -> Result<Vec<String>, ReportError> {
    let trainings = trainings(store, made)?;
    Ok(trainings.into_iter().flat_map(|training| training.warnings).collect())
}
