//! The course of each training.

use super::chart::{Chart, Mark, Series};
use crate::report::figures::{Axis, Training};
use crate::report::gather::{Made, ReportError, curves, each};
use crate::report::html::Page;
use crate::report::training::trainings;
use crate::store::Store;

/// Adds a section where something was trained.
pub fn section(page: &mut Page, store: &Store, made: &[Made]) -> Result<(), ReportError> {
    let trained = each(store, made, "train", |source| {
        Ok((source.stage.stage.clone(), curves(source)?))
    })?;
    if trained.is_empty() {
        return Ok(());
    }
    page.section("Training");
    for ((name, data), told) in trained.iter().zip(trainings(store, made)?) {
        page.part(name);
        page.lines(&[told.line]);
        page.markup(&format!(
            "<div class=\"charts\">\n{}{}</div>\n",
            loss(data),
            error(data)
        ));
    }
    Ok(())
}

fn by_epoch(values: &[f64]) -> Vec<(f64, f64)> {
    values
        .iter()
        .enumerate()
        .map(|(k, value)| ((k + 1) as f64, *value))
        .collect()
}

fn epochs(data: &Training) -> Axis {
    let last = data.train_loss.len().max(2) as f64;
    Axis::counting("Epoch", 1.0, last)
}

fn loss(data: &Training) -> String {
    let chart = Chart {
        title: "Loss",
        note: "",
        x: epochs(data),
        y: Axis::logarithmic("Loss", data.train_loss.iter().chain(&data.validation_loss)),
        series: vec![
            Series::new("training", "blue", Mark::LineAndDots, by_epoch(&data.train_loss)),
            Series::new(
                "validation",
                "vermillion",
                Mark::LineAndDots,
                by_epoch(&data.validation_loss),
            ),
        ],
    };
    chart.figure()
}

fn error(data: &Training) -> String {
    let errors = by_epoch(&data.validation_rmse);
    let kept = usize::try_from(data.kept)
        .ok()
        .and_then(|kept| errors.get(kept.wrapping_sub(1)));
    let kept: Vec<(f64, f64)> = kept.into_iter().copied().collect();
    let words = kept.iter().map(|(_, error)| format!("kept: {error:.4} mm")).collect();
    let chart = Chart {
        title: "Error",
        note: "root mean square of a displacement component, on samples held back",
        x: epochs(data),
        y: Axis::logarithmic("RMS error [mm]", &data.validation_rmse),
        series: vec![
            Series::new("validation", "vermillion", Mark::LineAndDots, errors),
            Series::new("", "vermillion", Mark::Labelled, kept).saying(words),
        ],
    };
    chart.figure()
}
