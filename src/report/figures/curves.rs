//! Results of a sweep over one of its axes, a curve for each value of another.

use std::path::Path;

use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};

/// What is drawn.
#[derive(Clone, Debug)]
pub struct Curves {
    /// Names of both axes with their units.
    pub labels: [String; 2],
    /// What stands along the axis from left to right instead of numbers: the points then lie at 0, 1, 2, …
    pub words: Vec<String>,
    /// The curves.
    pub curves: Vec<Curve>,
}

/// A curve.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Its name; none where there is one alone.
    pub name: String,
    /// Its points from left to right.
    pub points: Vec<(f64, f64)>,
}

/// Width and height of the chart.
const SIZE: [f64; 2] = [708.0, 410.0];

/// The chart of the curves.
///
/// # Errors
/// When there is none, or a number is not finite.
pub fn curves_chart(data: &Curves) -> Result<Chart, FigureError> {
    let points = || data.curves.iter().flat_map(|curve| &curve.points);
    if points().next().is_none() || points().any(|(x, y)| !x.is_finite() || !y.is_finite()) {
        return Err(FigureError::Data("curves need points of finite numbers".into()));
    }
    let (across, up): (Vec<f64>, Vec<f64>) = points().copied().unzip();
    let [x_label, y_label] = &data.labels;
    let x = match data.words.is_empty() {
        true => Axis::between(x_label, &across),
        false => Axis::names(data.words.clone()).with_label(x_label),
    };
    let mark = if data.words.is_empty() {
        Mark::LineAndDots
    } else {
        Mark::Dots
    };
    let curves = data.curves.iter().zip(Colour::ALL.into_iter().cycle());
    let series = curves.map(|(curve, colour)| Series::new(&curve.name, colour, mark, curve.points.clone()));
    let title = format!("{y_label} over {x_label}");
    Ok(Chart::new(title, [x, Axis::above(y_label, &up)], series.collect()).with_size(SIZE))
}

/// Draws the curves.
///
/// # Errors
/// When there is none, or the file cannot be written.
pub fn draw_curves(path: &Path, data: &Curves) -> Result<(), FigureError> {
    Sheet::charts(1, &[curves_chart(data)?]).write_png(path)
}
