//! Designs that taught what had predicted them: how well they were predicted, and how good they are, round by round.

use super::chart::{Chart, Mark, Series};
use super::words::{mm, percent};
use crate::report::course::Course;
use crate::report::figures::Axis;
use crate::report::gather::ReportError;
use crate::report::html::{Column, Page};
use crate::report::rounds::{BestOfTarget, RoundSummary, RoundsSummary, by_round};
use crate::report::summary::summarise;
use crate::store::Store;

/// Colours of targets, in their order.
const COLOURS: [&str; 7] = ["blue", "orange", "green", "vermillion", "purple", "sky", "grey"];

/// Adds a section where something was done in rounds.
pub fn section(page: &mut Page, store: &Store, course: &Course) -> Result<(), ReportError> {
    if course.rounds.is_empty() {
        return Ok(());
    }
    let found = by_round(&course.rounds, &summarise(store, &course.made())?);
    if found.is_empty() {
        return Ok(());
    }
    page.section("Rounds");
    page.lines(&[
        "Designs that were verified taught the surrogate that had predicted them, and the search began anew."
            .to_owned(),
    ]);
    for rounds in &found {
        page.part(&rounds.stage);
        page.columns(
            "Rounds",
            &COLUMNS,
            &rounds.rounds.iter().enumerate().map(row).collect::<Vec<_>>(),
        );
        page.markup(&format!(
            "<div class=\"charts\">\n{}{}</div>\n",
            differences(rounds),
            best(rounds)
        ));
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

/// A value of each round that has it.
fn over(rounds: &RoundsSummary, of: impl Fn(&RoundSummary) -> Option<f64>) -> Vec<(f64, f64)> {
    let values = rounds.rounds.iter().enumerate();
    values
        .filter_map(|(k, round)| Some(((k + 1) as f64, of(round)?)))
        .collect()
}

fn axis(rounds: &RoundsSummary) -> Axis {
    Axis::counting("Round", 0.5, rounds.rounds.len() as f64 + 0.5)
}

fn differences(rounds: &RoundsSummary) -> String {
    let of = |of: fn(&RoundSummary) -> Option<f64>| over(rounds, move |round| Some(100.0 * of(round)?));
    let (rms, largest) = (of(|round| round.rms_relative), of(|round| round.largest_relative));
    let values: Vec<f64> = rms.iter().chain(&largest).map(|(_, percent)| *percent).collect();
    let chart = Chart {
        title: "Predicted against simulated",
        note: "difference in percent of what is simulated",
        x: axis(rounds),
        y: Axis::above("Difference [%]", &values),
        series: vec![
            Series::new("largest", "vermillion", Mark::LineAndDots, largest),
            Series::new("root mean square", "blue", Mark::LineAndDots, rms),
        ],
    };
    chart.figure()
}

fn best(rounds: &RoundsSummary) -> String {
    let mut targets: Vec<(&str, &str)> = Vec::new();
    let all = || rounds.rounds.iter().flat_map(|round| &round.best);
    for best in all() {
        let target = (best.case.as_str(), best.name.as_str());
        if !targets.contains(&target) {
            targets.push(target);
        }
    }
    let series = |((case, name), colour): (&(&str, &str), &&'static str)| {
        let is = |best: &&BestOfTarget| best.case == *case && best.name == *name;
        let points = over(rounds, |round| Some(round.best.iter().find(is)?.simulated_mm));
        Series::new(format!("{case} {name}").trim(), colour, Mark::LineAndDots, points)
    };
    let values: Vec<f64> = all().map(|best| best.simulated_mm).collect();
    let chart = Chart {
        title: "Best of each target",
        note: "as simulated",
        x: axis(rounds),
        y: Axis::above("Displacement [mm]", &values),
        series: targets.iter().zip(COLOURS.iter().cycle()).map(series).collect(),
    };
    chart.figure()
}
