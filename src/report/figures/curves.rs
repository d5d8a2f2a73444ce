//! Results of a sweep over one of its axes, with a curve for each value of another.

use crate::drawing::{Axis, Chart, FigureError, LARGE, Mark, Series, Sheet};

/// The curves of a sweep.
#[derive(Clone, Debug)]
pub struct Curves {
    /// Labels of both axes with their units.
    pub labels: [String; 2],
    /// Names along the horizontal axis instead of numbers: the points then lie at 0, 1, 2, …
    pub names: Vec<String>,
    /// What is not drawn, because it has no value.
    pub missing: Option<String>,
    /// The curves.
    pub curves: Vec<Curve>,
}

/// A curve.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Its name; empty if there is only one.
    pub name: String,
    /// Its points from left to right.
    pub points: Vec<(f64, f64)>,
}

/// Draws the curves.
///
/// # Errors
/// If there is no point, or a number is not finite.
pub fn curves_chart(data: &Curves) -> Result<Chart, FigureError> {
    let points = || data.curves.iter().flat_map(|curve| &curve.points);
    if points().next().is_none() || points().any(|(x, y)| !x.is_finite() || !y.is_finite()) {
        return Err(FigureError::Data("curves need points with finite numbers".into()));
    }
    let (across, up): (Vec<f64>, Vec<f64>) = points().copied().unzip();
    let [x_label, y_label] = &data.labels;
    let (x, mark) = match data.names.is_empty() {
        true => (Axis::between(x_label, &across), Mark::LineAndDots),
        false => (Axis::names(data.names.clone()).with_label(x_label), Mark::Dots),
    };
    let series = Series::coloured(&data.curves);
    let series = series.map(|(curve, colour)| Series::new(&curve.name, colour, mark, curve.points.clone()));
    let missing = data.missing.iter().map(|missing| format!("; {missing}"));
    let title = format!("{y_label} over {x_label}{}", missing.collect::<String>());
    Ok(Chart::new(title, [x, Axis::above(y_label, &up)], series.collect()).with_size(LARGE))
}

/// Draws the curves on a sheet.
///
/// # Errors
/// If there is no point, or a number is not finite.
pub fn curves_sheet(data: &Curves) -> Result<Sheet, FigureError> {
    Ok(Sheet::charts(1, &[curves_chart(data)?]))
}
