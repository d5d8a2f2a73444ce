//! Measured curves beside a fitted law.

use crate::drawing::{Axis, Chart, FigureError, LARGE, Mark, Series, Sheet};

/// A measured curve beside the fitted one.
#[derive(Clone, Debug)]
pub struct FittedCurve {
    /// Its name.
    pub name: String,
    /// The measured points.
    pub measured: Vec<(f64, f64)>,
    /// The fitted curve.
    pub fitted: Vec<(f64, f64)>,
}

/// Draws measured points as dots and the fitted curves as lines, each pair in one colour.
///
/// # Errors
/// If there is no point, or a number is not finite.
pub fn fit_sheet(title: &str, labels: [&str; 2], curves: &[FittedCurve]) -> Result<Sheet, FigureError> {
    Ok(Sheet::charts(1, &[chart(title, labels, [false; 2], curves)?]))
}

/// As [`fit_sheet`], without a sheet, with axes that may be logarithmic.
pub(super) fn chart(
    title: &str,
    labels: [&str; 2],
    logarithmic: [bool; 2],
    curves: &[FittedCurve],
) -> Result<Chart, FigureError> {
    let points = || {
        curves
            .iter()
            .flat_map(|curve| curve.measured.iter().chain(&curve.fitted))
    };
    if points().next().is_none() || points().any(|(x, y)| !x.is_finite() || !y.is_finite()) {
        return Err(FigureError::Data("a fit needs points with finite numbers".into()));
    }
    let (across, up): (Vec<f64>, Vec<f64>) = points().copied().unzip();
    let series = Series::coloured(curves).flat_map(|(curve, colour)| {
        [
            Series::new(&curve.name, colour, Mark::Dots, curve.measured.clone()),
            Series::new("", colour, Mark::Line, curve.fitted.clone()),
        ]
    });
    let axis = |at: usize, values: &[f64]| match logarithmic[at] {
        true => Axis::logarithmic(labels[at], values),
        false => Axis::between(labels[at], values),
    };
    let axes = [axis(0, &across), axis(1, &up)];
    Ok(Chart::new(title, axes, series.collect()).with_size(LARGE))
}
