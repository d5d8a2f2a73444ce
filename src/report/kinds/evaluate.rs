//! Evaluate stages: errors of surrogates on patterns that they were not trained on.

use maud::{Markup, html};

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::drawing::Sheet;
use crate::error::ReportError;
use crate::evaluation::{Coverage, Evaluation, PredictorScores, read};
use crate::figures::{EvaluationFigure, PredictorErrors};
use crate::format::{percent, r_squared};
use crate::html::{Column, Page};
use crate::presenter::{Figures, Headline, Presenter, Results};
use deaflow_base::two_digits;
use deaflow_content as content;

/// Presents evaluate stages.
pub struct EvaluatePresenter;

impl Presenter for EvaluatePresenter {
    fn kind(&self) -> &'static str {
        "evaluate"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let evaluations = run.each(self.kind(), read)?;
        let text = evaluations.iter().map(ToString::to_string);
        let warnings = evaluations.iter().flat_map(Evaluation::warnings).collect();
        Ok(vec![
            Results::new("evaluations", &evaluations, text).with_warnings(warnings),
        ])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let evaluations = run.each(self.kind(), read)?;
        Ok(evaluations
            .iter()
            .filter_map(Evaluation::result)
            .map(Headline::good)
            .collect())
    }

    fn figures(&self) -> Figures {
        &[("evaluation", figure)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let found = run.each(self.kind(), |source| Ok((read(source)?, evaluated(source)?)))?;
        for (evaluation, data) in &found {
            page.open("Surrogates", "");
            page.part(&evaluation.stage);
            page.line(
                "Root mean square error of a displacement component in mm, by family; darker cells have larger errors.",
            );
            page.scrolled("Errors by family", &matrix(evaluation, data));
            let scopes = evaluation.predictors.iter().filter_map(|p| evaluation.scope(p));
            page.lines(&scopes.collect::<Vec<_>>());
            if !evaluation.calibrations.is_empty() {
                page.line("Intervals of 95 %, and their coverage:");
                intervals(page, evaluation);
                let validity = |c: &Coverage| evaluation.validity(c).map(|line| format!("{}: {line}.", c.name));
                page.lines(&evaluation.calibrations.iter().flat_map(validity).collect::<Vec<_>>());
            }
            page.charts(&data.charts());
        }
        Ok(())
    }
}

fn figure(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    source.drawn(evaluated(source)?.sheet()).map(Some)
}

/// Reads the errors of an evaluate stage by family, and the largest displacements of its patterns.
fn evaluated(source: &ArtifactReader<'_>) -> Result<EvaluationFigure, ReportError> {
    let found = read(source)?;
    let patterns = source.of(content::Evaluation::open(source.artifact))?.pattern();
    let simulated = source.of(patterns.simulated_max().read())?;
    let predicted = source.of(patterns.predicted_max().read())?;
    let known = source.of(patterns.predicted().read())?;
    let n = simulated.len();
    let predictor = |(k, predictor): (usize, &PredictorScores)| {
        let rmse = predictor.rmse_mm.iter().zip(&predictor.samples);
        let rows = (0..n).filter(|row| known[k * n + row] == 1);
        PredictorErrors {
            name: predictor.name.clone(),
            rmse: rmse.map(|(rmse, samples)| (*samples > 0).then_some(*rmse)).collect(),
            peaks: rows.map(|row| (simulated[row], predicted[k * n + row])).collect(),
            peak_r2: predictor.max_displacement_r2.last().copied().unwrap_or_default(),
        }
    };
    Ok(EvaluationFigure {
        predictors: found.predictors.iter().enumerate().map(predictor).collect(),
        families: found.families,
    })
}

/// Writes the errors as a table with shades.
fn matrix(evaluation: &Evaluation, data: &EvaluationFigure) -> Markup {
    let titles = evaluation.families.iter().map(String::as_str);
    let shaded = |error: f64| format!("background:rgba(var(--heat),{:.2})", 0.05 + 0.4 * data.shade(error));
    let last = |values: &[f64]| values.last().copied().unwrap_or_default();
    html! {
        table {
            thead {
                tr {
                    th scope="col" {}
                    @for title in titles.chain(["R² of the largest", "largest error"]) {
                        th.number scope="col" { (title) }
                    }
                }
            }
            tbody {
                @for (predictor, drawn) in evaluation.predictors.iter().zip(&data.predictors) {
                    tr {
                        th scope="row" { (predictor.name) }
                        @for error in &drawn.rmse {
                            @if let Some(error) = error { td.heat style=(shaded(*error)) { (two_digits(*error)) } }
                            @else { td.heat { "none" } }
                        }
                        td.heat { (r_squared(last(&predictor.max_displacement_r2))) }
                        td.heat { (two_digits(last(&predictor.max_error_mm))) }
                    }
                }
            }
        }
    }
}

fn intervals(page: &mut Page, evaluation: &Evaluation) {
    let families = evaluation
        .families
        .iter()
        .map(|family| (family.as_str(), Column::Number));
    let columns: Vec<(&str, Column)> = [("", Column::Key), ("", Column::Key)]
        .into_iter()
        .chain(families)
        .collect();
    let row = |name: &str, what: &str, values: Vec<String>| [vec![name.to_owned(), what.to_owned()], values].concat();
    let percents = |values: &[f64]| values.iter().map(|v| percent(*v, 1)).collect::<Vec<_>>();
    let of = |c: &Coverage| {
        vec![
            row(&c.name, "whole field lies in its band", percents(&c.field)),
            row(
                "",
                "half width of the band, mm",
                c.radius_mm.iter().map(|r| two_digits(*r)).collect(),
            ),
            row(
                "",
                "displacement of a point lies in its interval",
                percents(&c.points()),
            ),
            row("", "flagged as out of distribution", percents(&c.unlike)),
            row("", "whole field, if not flagged", c.unflagged_covered()),
        ]
    };
    let rows: Vec<Vec<String>> = evaluation.calibrations.iter().flat_map(of).collect();
    page.columns("Coverage of intervals", &columns, &rows);
}
