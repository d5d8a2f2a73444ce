//! Measured beside simulated numbers: curves, and maps of their difference.

use super::fit::{FittedCurve, curve_chart};
use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};
use crate::format::three;

/// Measured numbers beside simulated ones.
#[derive(Clone, Debug)]
pub enum MeasuredFigure {
    /// A curve.
    Curve {
        /// The labels of both axes.
        labels: [String; 2],
        /// Whether each axis is logarithmic.
        logarithmic: [bool; 2],
        /// The points and the simulated curve.
        curve: FittedCurve,
    },
    /// A field of a membrane.
    Map {
        /// Its name.
        name: String,
        /// Sides of the membrane in mm.
        size_mm: [f64; 2],
        /// Points on it in mm.
        points_mm: Vec<[f64; 2]>,
        /// A length at each point, in mm.
        lengths_mm: Vec<f64>,
        /// What the lengths are.
        note: &'static str,
    },
}

/// The longer side of a map in pixels.
const SIDE: f64 = 360.0;

/// Maps with more points have smaller dots, so that these do not cover each other.
const MOST_DOTS: usize = 400;

/// The colours of lengths, each for a quarter of the largest.
const COLOURS: [Colour; 4] = [Colour::Sky, Colour::Blue, Colour::Orange, Colour::Vermillion];

/// Draws a chart for each of them, two in a row.
///
/// # Errors
/// If there is none, one has no point, or a number is not finite.
pub fn measured_sheet(figures: &[MeasuredFigure]) -> Result<Sheet, FigureError> {
    let charts = measured_charts(figures)?;
    match charts.is_empty() {
        true => Err(FigureError::Data("there is nothing to draw".into())),
        false => Ok(Sheet::charts(charts.len().min(2), &charts)),
    }
}

/// Draws a chart for each of them.
///
/// # Errors
/// If one has no point, or a number is not finite.
pub fn measured_charts(figures: &[MeasuredFigure]) -> Result<Vec<Chart>, FigureError> {
    figures.iter().map(of_figure).collect()
}

fn of_figure(figure: &MeasuredFigure) -> Result<Chart, FigureError> {
    match figure {
        MeasuredFigure::Curve {
            labels,
            logarithmic,
            curve,
        } => curve_chart(curve, labels.each_ref().map(String::as_str), *logarithmic),
        MeasuredFigure::Map {
            name,
            size_mm,
            points_mm,
            lengths_mm,
            note,
        } => Ok(map(name, *size_mm, points_mm, lengths_mm)?.with_note(*note)),
    }
}

fn map(name: &str, size_mm: [f64; 2], points_mm: &[[f64; 2]], lengths_mm: &[f64]) -> Result<Chart, FigureError> {
    let largest = lengths_mm.iter().copied().fold(0.0, f64::max);
    if points_mm.is_empty() || lengths_mm.iter().any(|d| !d.is_finite()) {
        return Err(FigureError::Data("a map needs points with finite numbers".into()));
    }
    let quarters = COLOURS.len() as f64;
    let mark = match points_mm.len() <= MOST_DOTS {
        true => Mark::Dots,
        false => Mark::Cloud,
    };
    let quarter = |length: f64| match largest > 0.0 {
        true => ((quarters * length / largest) as usize).min(COLOURS.len() - 1),
        false => 0,
    };
    let series = COLOURS.into_iter().enumerate().map(|(number, colour)| {
        let own = points_mm.iter().zip(lengths_mm).filter(|(_, d)| quarter(**d) == number);
        let [lower, upper] = [number, number + 1].map(|end| three(largest * end as f64 / quarters));
        let label = format!("{lower} to {upper} mm");
        Series::new(&label, colour, mark, own.map(|([x, y], _)| (*x, *y)).collect())
    });
    let axes = [
        Axis::linear("x, mm", 0.0, size_mm[0]),
        Axis::linear("y, mm", 0.0, size_mm[1]),
    ];
    let scale = SIDE / size_mm[0].max(size_mm[1]);
    let chart = Chart::new(name, axes, series.collect());
    Ok(chart.with_frame(size_mm.map(|side| scale * side)))
}
