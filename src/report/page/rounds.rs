//! Designs that taught what had predicted them: how well they were predicted, and how good they are, round by round.

use crate::report::course::Course;
use crate::report::figures::rounds_charts;
use crate::report::format::{mm, percent};
use crate::report::gather::ReportError;
use crate::report::html::{Column, Page};
use crate::report::rounds::{RoundSummary, by_round, drawn};
use crate::report::summary::summarise;
use crate::store::Store;

/// Adds a section where something was done in rounds.
pub fn section(page: &mut Page, store: &Store, course: &Course) -> Result<(), ReportError> {
    if course.rounds.is_empty() {
        return Ok(());
    }
    let summaries = summarise(store, &course.made())?;
    let found = by_round(&course.rounds, &summaries);
    if found.is_empty() {
        return Ok(());
    }
    page.section("Rounds");
    page.line("Designs that were verified taught the surrogate that had predicted them, and the search began anew.");
    for rounds in &found {
        page.part(&rounds.stage);
        let rows: Vec<Vec<String>> = rounds.rounds.iter().enumerate().map(row).collect();
        page.columns("Rounds", &COLUMNS, &rows);
        let charts = rounds_charts(&drawn(rounds, &summaries)).map_err(|source| ReportError::Figure {
            stage: rounds.stage.clone(),
            source,
        })?;
        page.charts(&charts);
    }
    Ok(())
}

const COLUMNS: [(&str, Column); 6] = [
    ("round", Column::Number),
    ("stage", Column::Key),
    ("designs", Column::Number),
    ("RMS difference, mm", Column::Number),
    ("RMS difference", Column::Number),
    ("largest difference", Column::Number),
];

fn row((k, round): (usize, &RoundSummary)) -> Vec<String> {
    let share = |value: Option<f64>| value.map_or_else(String::new, |value| percent(value, 2));
    vec![
        (k + 1).to_string(),
        round.stage.clone(),
        round.designs.to_string(),
        round.rms_mm.map_or_else(String::new, mm),
        share(round.rms_relative),
        share(round.largest_relative),
    ]
}
