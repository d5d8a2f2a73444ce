//! Surrogates judged by patterns that none of them has seen.

use super::chart::{Chart, Mark, Series};
use super::words::percent;
use crate::report::evaluation::{Coverage, Evaluation, read, short};
use crate::report::figures::{Axis, Evaluated};
use crate::report::gather::{Made, ReportError, each, evaluated};
use crate::report::html::{Column, Page, escaped};
use crate::store::Store;

/// Dots in one chart: more only cover each other.
const MOST_DOTS: usize = 1500;

/// Adds a section where surrogates were evaluated.
pub fn section(page: &mut Page, store: &Store, made: &[Made]) -> Result<(), ReportError> {
    let found = each(store, made, "evaluate", |source| {
        Ok((read(source)?, evaluated(source)?))
    })?;
    if found.is_empty() {
        return Ok(());
    }
    page.section("Surrogates");
    for (evaluation, data) in &found {
        page.part(&evaluation.stage);
        page.lines(&[
            "Root mean square error of a displacement component in mm, by family of patterns; dark cells err more."
                .to_owned(),
        ]);
        page.scrolled("Errors by family", &matrix(evaluation));
        if !evaluation.calibrations.is_empty() {
            page.lines(&["Intervals of 95 %, and how often they cover:".to_owned()]);
            intervals(page, evaluation);
        }
        page.markup(&format!("<div class=\"charts\">\n{}</div>\n", scatter(data)));
    }
    Ok(())
}

/// Errors with their shades, from the smallest to the largest of all on a logarithmic scale.
fn matrix(evaluation: &Evaluation) -> String {
    let all = || {
        evaluation
            .predictors
            .iter()
            .flat_map(|p| &p.rmse_mm)
            .filter(|e| **e > 0.0)
    };
    let (low, high) = all().fold((f64::INFINITY, 0.0), |(l, h): (f64, f64), e| (l.min(*e), h.max(*e)));
    let shade = |error: f64| match error > 0.0 && high > low {
        true => 0.05 + 0.4 * (error / low).ln() / (high / low).ln(),
        false => 0.0,
    };
    let titles = evaluation.families.iter().map(String::as_str);
    let titles = titles.chain(["R² of the largest", "largest error"]);
    let head: String = titles
        .map(|t| format!("<th scope=\"col\" class=\"number\">{}</th>", escaped(t)))
        .collect();
    let mut rows = String::new();
    for predictor in &evaluation.predictors {
        rows += &format!("<tr><th scope=\"row\">{}</th>", escaped(&predictor.name));
        for (error, samples) in predictor.rmse_mm.iter().zip(&predictor.samples) {
            rows += &match samples {
                0 => "<td class=\"heat\">none</td>".to_owned(),
                _ => format!(
                    "<td class=\"heat\" style=\"background:rgba(var(--heat),{:.2})\">{}</td>",
                    shade(*error),
                    short(*error)
                ),
            };
        }
        let r2 = predictor.max_displacement_r2.last().copied().unwrap_or_default();
        let largest = predictor.max_error_mm.last().copied().unwrap_or_default();
        rows += &format!(
            "<td class=\"heat\">{r2:.5}</td><td class=\"heat\">{}</td></tr>\n",
            short(largest)
        );
    }
    format!("<table>\n<thead><tr><th scope=\"col\"></th>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table>\n")
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
    let shares = |values: &[f64]| values.iter().map(|v| percent(*v, 1)).collect::<Vec<_>>();
    let of = |c: &Coverage| {
        let points = (0..evaluation.families.len()).map(|k| {
            let covered: f64 = c.objectives.iter().map(|o| o.covered[k]).sum();
            covered / c.objectives.len().max(1) as f64
        });
        vec![
            row(&c.name, "whole field lies in its band", shares(&c.field)),
            row(
                "",
                "half width of the band, mm",
                c.radius_mm.iter().map(|r| short(*r)).collect(),
            ),
            row(
                "",
                "displacement of a point lies in its interval",
                shares(&points.collect::<Vec<_>>()),
            ),
            row("", "flagged as unlike the training", shares(&c.unlike)),
        ]
    };
    let rows: Vec<Vec<String>> = evaluation.calibrations.iter().flat_map(of).collect();
    page.columns("Coverage of intervals", &columns, &rows);
}

fn scatter(data: &Evaluated) -> String {
    let peaks = data.predictors.iter().flat_map(|p| &p.peaks);
    let largest = peaks.fold(0.0, |l: f64, (a, b)| l.max(*a).max(*b));
    let end = if largest > 0.0 { 1.06 * largest } else { 1.0 };
    let mut out = String::new();
    for predictor in data.predictors.iter().filter(|p| !p.peaks.is_empty()) {
        let n = predictor.peaks.len();
        let dots = predictor
            .peaks
            .iter()
            .step_by(n.div_ceil(MOST_DOTS).max(1))
            .copied()
            .collect();
        let chart = Chart {
            title: &predictor.name,
            note: &format!("R² {:.5}, {n} patterns", predictor.peak_r2),
            x: Axis::linear("Largest displacement, simulated [mm]", 0.0, end),
            y: Axis::linear("Predicted [mm]", 0.0, end),
            series: vec![
                Series::new("", "grey", Mark::Dashed, vec![(0.0, 0.0), (end, end)]),
                Series::new("", "blue", Mark::Cloud, dots),
            ],
        };
        out += &chart.figure();
    }
    out
}
