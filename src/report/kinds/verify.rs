//! Verify stages: designs as predicted and as simulated, and what rounds made of them.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::artifacts::{RunArtifacts, Source};
use crate::designs::membranes;
use crate::drawing::Membrane;
use crate::error::ReportError;
use crate::figures::{Case, draw_agreement, draw_gallery, rounds_charts};
use crate::format::{mm, share};
use crate::headline::Headline;
use crate::html::{Column, Page};
use crate::in_time::InTime;
use crate::presenter::{DrawFigure, Presenter, Results};
use crate::rounds::{RoundSummary, by_round, draw_by_round, drawn};
use crate::summary::{RowSummary, Summary, read};
use deaflow_base::Document;
use deaflow_content::Verification;
use deaflow_pattern::Role;

/// Shows verify stages.
pub struct Verify;

impl Presenter for Verify {
    fn kind(&self) -> &'static str {
        "verify"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let summaries = run.each(self.kind(), read)?;
        let rounds = by_round(run.rounds, &summaries);
        let in_time = in_time(run)?;
        let results = |key: &str, value, text| Results {
            key: key.to_owned(),
            value,
            text,
            warnings: Vec::new(),
        };
        Ok(vec![
            results(
                "results",
                json!(summaries),
                summaries.iter().map(ToString::to_string).collect(),
            ),
            results(
                "rounds",
                json!(rounds),
                rounds.iter().map(ToString::to_string).collect(),
            ),
            results(
                "in_time",
                json!(in_time),
                in_time.iter().map(ToString::to_string).collect(),
            ),
        ])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let summaries = run.each(self.kind(), read)?;
        // The results of all stages, then how exact their predictions were.
        let results = summaries.iter().map(Summary::result);
        let accuracies = summaries.iter().filter_map(Summary::accuracy);
        Ok(results.chain(accuracies).collect())
    }

    fn figures(&self) -> &'static [(&'static str, DrawFigure)] {
        &[("verification", verification)]
    }

    fn common_figures(&self, run: &RunArtifacts<'_>, folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
        if run.rounds.is_empty() {
            return Ok(Vec::new());
        }
        let summaries = run.each(self.kind(), read)?;
        draw_by_round(folder, run.made, &by_round(run.rounds, &summaries), &summaries)
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        in_time(run)?.iter().for_each(|stage| stage.show(page));
        if run.rounds.is_empty() {
            return Ok(());
        }
        let summaries = run.each(self.kind(), read)?;
        for rounds in &by_round(run.rounds, &summaries) {
            page.open(
                "Rounds",
                "Designs that were verified taught the surrogate that had predicted them, and the search began anew.",
            );
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
}

/// The stages that were asked for several times.
fn in_time(run: &RunArtifacts<'_>) -> Result<Vec<InTime>, ReportError> {
    let each = run.each("verify", InTime::read)?;
    Ok(each.into_iter().flatten().collect())
}

/// Patterns without a stable solution have no field to draw, and without any there is no figure; the summary names them. Of many
/// targets each one's best design is drawn.
fn verification(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let summary = read(source)?;
    let mut rows: Vec<(usize, usize)> = Vec::new();
    for (row, case) in summary.rows.iter().enumerate() {
        if case.simulated_mm.is_some() {
            rows.push((row, rows.len()));
        }
    }
    let view = source.of(Verification::open(source.artifact))?;
    let constraints = source.of(view.rows().constraints().read())?.0;
    if rows.len() > MOST_COMPARED {
        rows = best_of_targets(&summary, &rows);
        let (objectives, areas) = (
            source.of(view.rows().objective().read())?.0,
            source.of(view.rows().area_target().read())?,
        );
        beside_each_other(&mut rows, |row| {
            let case = &summary.rows[row];
            (&case.name, &objectives[row], &areas[row], case.member)
        });
    }
    let fields = source.of(view.displacement().read())?;
    let wanted = rows.iter().map(|&(row, at)| (row, &fields[at]));
    let drawn = membranes(source, &view.rows(), &view.scene(), wanted)?;
    let case = |(&(row, _), membrane): (&(usize, usize), Membrane)| {
        let summary = &summary.rows[row];
        Case {
            name: summary.title(),
            membrane,
            predicted: summary.predicted_mm,
            simulated: summary.simulated_mm.unwrap_or(0.0),
            gain: summary.gain_own_area,
            least_width: least_width(&constraints[row]),
        }
    };
    let cases: Vec<Case> = rows.iter().zip(drawn).map(case).collect();
    match cases.len() {
        0 => Ok(()),
        1..=MOST_COMPARED => source.drawn(draw_agreement(path, &cases)),
        _ => source.drawn(draw_gallery(path, &cases)),
    }
}

/// The least width of electrodes and gaps that a design had to keep, as it was written; none where edges may be frayed.
fn least_width(constraints: &str) -> Option<String> {
    let document = Document::from_text(Path::new("constraints"), constraints).ok()?;
    Some(document.root.peek("min_feature")?.written())
}

/// Moves rows with the same key, designs of one target under several constraints, behind the first of them.
fn beside_each_other<K: PartialEq>(rows: &mut [(usize, usize)], key: impl Fn(usize) -> K) {
    let keys: Vec<K> = rows.iter().map(|(row, _)| key(*row)).collect();
    let first = |at: usize| keys.iter().position(|other| *other == keys[at]);
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by_key(|at| first(*at));
    let sorted: Vec<(usize, usize)> = order.iter().map(|at| rows[*at]).collect();
    rows.copy_from_slice(&sorted);
}

/// Patterns that are drawn beside each other with their numbers as bars.
const MOST_COMPARED: usize = 6;

/// The refined design of each target and member where there is one, else the genetic algorithm's, else the optimum; and a person's own
/// patterns.
fn best_of_targets(summary: &Summary, rows: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let mut best: Vec<(usize, usize)> = Vec::new();
    for &(row, field) in rows {
        let case = &summary.rows[row];
        if case.role == Role::Own {
            best.push((row, field));
            continue;
        }
        if !case.role.is_found() {
            continue;
        }
        let identity = |case: &RowSummary| (case.case.clone(), case.name.clone(), case.member);
        let place = best.iter().position(|&(other, _)| {
            summary.rows[other].is_design() && identity(&summary.rows[other]) == identity(case)
        });
        match place {
            None => best.push((row, field)),
            Some(place) => {
                if case.role < summary.rows[best[place].0].role {
                    best[place] = (row, field);
                }
            }
        }
    }
    best
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
    let in_percent = |value: Option<f64>| value.map_or_else(String::new, share);
    vec![
        (k + 1).to_string(),
        round.stage.clone(),
        round.designs.to_string(),
        round.rms_mm.map_or_else(String::new, mm),
        in_percent(round.rms_relative),
        in_percent(round.largest_relative),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn designs_of_one_target_stand_beside_each_other_with_their_least_widths() {
        let mut rows = [(0, 0), (1, 1), (2, 2), (3, 3)];
        let names = ["a", "b", "b", "a"];
        beside_each_other(&mut rows, |row| names[row]);
        assert_eq!(rows, [(0, 0), (3, 3), (1, 1), (2, 2)]);
        let widths = ["{ min_feature: 3 mm, leads: true }", "{}", "["].map(least_width);
        assert_eq!(widths, [Some("3 mm".to_owned()), None, None]);
    }
}
