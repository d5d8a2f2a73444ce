//! Verify stages: predicted and simulated displacements of designs, and the results of rounds.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::designs::{VOLUME_UNIT, membranes};
use crate::drawing::{DeformedMembrane, Sheet};
use crate::error::ReportError;
use crate::figures::{VerifiedPattern, agreement_sheet, gallery_sheet, rounds_charts};
use crate::format::{mm, percents};
use crate::html::{Column, Page};
use crate::in_time::InTime;
use crate::presenter::{Figures, Headline, Presenter, Results};
use crate::rounds::{RoundSummary, by_round, draw_by_round, drawn};
use crate::summary::{RowSummary, VerificationSummary, read};
use deaflow_base::Document;
use deaflow_content::Verification;
use deaflow_field::REACTION_UNIT;
use deaflow_pattern::Role;

/// Presents verify stages.
pub struct VerifyPresenter;

impl Presenter for VerifyPresenter {
    fn kind(&self) -> &'static str {
        "verify"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let summaries = run.each(self.kind(), read)?;
        let rounds = by_round(run.rounds, &summaries);
        let summaries: Vec<VerificationSummary> = summaries.into_iter().map(VerificationSummary::sorted).collect();
        let in_time = in_time(run)?;
        Ok(vec![
            Results::new(
                "results",
                &with_units(&summaries),
                summaries.iter().map(ToString::to_string),
            ),
            Results::new("rounds", &rounds, rounds.iter().map(ToString::to_string)),
            Results::new("in_time", &in_time, in_time.iter().map(ToString::to_string)),
        ])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let summaries = run.each(self.kind(), read)?;
        // The results of all stages, then the errors of their predictions.
        let results = summaries.iter().map(VerificationSummary::result);
        let accuracies = summaries.iter().filter_map(VerificationSummary::accuracy);
        Ok(results.chain(accuracies).collect())
    }

    fn figures(&self) -> Figures {
        &[("verification", verification)]
    }

    fn common_figures(&self, run: &RunArtifacts<'_>, folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
        if run.rounds.is_empty() {
            return Ok(Vec::new());
        }
        let summaries = run.each(self.kind(), read)?;
        draw_by_round(folder, run.stages, &by_round(run.rounds, &summaries), &summaries)
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
                "The verified designs were added to the training of the surrogate, and the search was repeated.",
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

/// Returns summaries whose values in mN have keys that end with `_mN`.
fn with_units(summaries: &[VerificationSummary]) -> Vec<Value> {
    let mut all: Vec<Value> = summaries.iter().map(|summary| json!(summary)).collect();
    let forces = all.iter_mut().filter(|summary| summary.get("unit").is_some());
    let rows = forces.filter_map(|summary| summary.get_mut("rows")?.as_array_mut());
    for row in rows.flatten().filter_map(Value::as_object_mut) {
        for value in [
            "predicted",
            "simulated",
            "simulated_error",
            "difference",
            "gain_own_area",
            "gain_equal_area",
            "difference_to_optimum",
        ] {
            if let Some(known) = row.remove(&format!("{value}_mm")) {
                row.insert(format!("{value}_{REACTION_UNIT}"), known);
            }
        }
    }
    all
}

/// Reads the stages that have several times.
fn in_time(run: &RunArtifacts<'_>) -> Result<Vec<InTime>, ReportError> {
    let each = run.each("verify", InTime::read)?;
    Ok(each.into_iter().flatten().collect())
}

/// Draws the patterns with a stable solution; without one there is no figure. If there are many patterns, only the best
/// design of each target is drawn.
fn verification(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let summary = read(source)?;
    let mut rows: Vec<(usize, usize)> = Vec::new();
    for (row, case) in summary.rows.iter().enumerate() {
        if case.simulated_mm.is_some() {
            rows.push((row, rows.len()));
        }
    }
    let view = source.of(Verification::open(source.artifact))?;
    let constraints = source.of(view.rows().constraints().read())?.0;
    if rows.len() > MAX_WITH_BARS {
        rows = best_of_targets(&summary, &rows);
        let (objectives, areas) = (
            source.of(view.rows().objective().read())?.0,
            source.of(view.rows().area_target().read())?,
        );
        group_by_key(&mut rows, |row| {
            let case = &summary.rows[row];
            (&case.name, &objectives[row], &areas[row], case.member)
        });
    }
    let fields = source.of(view.displacement().read())?;
    let selected = rows.iter().map(|&(row, at)| (row, &fields[at]));
    let membranes = membranes(source, &view.rows(), &view.scene(), selected)?;
    // Bars of lengths and volumes have one axis: that of the files.
    let is_volume = |(row, _): &(usize, usize)| summary.rows[*row].objective.ml_per_mm.is_some();
    let has_volumes_only = rows.iter().all(is_volume);
    let case = |(&(row, _), membrane): (&(usize, usize), DeformedMembrane)| {
        let (unit, summary) = (summary.unit, &summary.rows[row]);
        let shown = |value: f64| match has_volumes_only {
            true => summary.objective.shown(value),
            false => value,
        };
        VerifiedPattern {
            name: summary.title(),
            membrane,
            predicted: summary.comparable_prediction_mm().map(shown),
            simulated: shown(summary.simulated_mm.unwrap_or(0.0)),
            error: summary.simulated_error_mm.map(shown),
            unit: if has_volumes_only { VOLUME_UNIT } else { unit },
            least_width: least_width(&constraints[row]),
        }
    };
    let cases: Vec<VerifiedPattern> = rows.iter().zip(membranes).map(case).collect();
    let sheet = match cases.len() {
        0 => return Ok(None),
        1..=MAX_WITH_BARS => agreement_sheet(&cases),
        _ => gallery_sheet(&cases),
    };
    source.drawn(sheet).map(Some)
}

/// Returns the required minimum width of electrodes and gaps, as written in the constraints.
fn least_width(constraints: &str) -> Option<String> {
    let document = Document::from_text(Path::new("constraints"), constraints).ok()?;
    Some(document.root.peek("min_feature")?.written())
}

/// Moves rows with the same key behind the first of them, so that designs of a target are together.
fn group_by_key<K: PartialEq>(rows: &mut [(usize, usize)], key: impl Fn(usize) -> K) {
    let keys: Vec<K> = rows.iter().map(|(row, _)| key(*row)).collect();
    let first = |at: usize| keys.iter().position(|other| *other == keys[at]);
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by_key(|at| first(*at));
    let sorted: Vec<(usize, usize)> = order.iter().map(|at| rows[*at]).collect();
    rows.copy_from_slice(&sorted);
}

/// The largest number of patterns that are drawn with bars.
const MAX_WITH_BARS: usize = 6;

/// Selects the refined design of each target and member, or else that of the genetic algorithm, or else the optimum;
/// and all own patterns.
fn best_of_targets(summary: &VerificationSummary, rows: &[(usize, usize)]) -> Vec<(usize, usize)> {
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
    let in_percent = |value: Option<f64>| value.map_or_else(String::new, percents);
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
    fn designs_of_a_target_are_grouped_and_have_their_minimum_widths() {
        let mut rows = [(0, 0), (1, 1), (2, 2), (3, 3)];
        let names = ["a", "b", "b", "a"];
        group_by_key(&mut rows, |row| names[row]);
        assert_eq!(rows, [(0, 0), (3, 3), (1, 1), (2, 2)]);
        let widths = ["{ min_feature: 3 mm, leads: true }", "{}", "["].map(least_width);
        assert_eq!(widths, [Some("3 mm".to_owned()), None, None]);
    }
}
