//! Models and estimates: the error of each on each family, and the largest displacement, predicted over simulated.

use maud::{Markup, html};

use crate::drawing::{Axis, Chart, Colour, EMPTY, FigureError, Mark, Series, Sheet, extent};
use crate::format::{cut, r_squared};
use deaflow_base::two_digits;

/// The data of the figure of an evaluation.
#[derive(Clone, Debug)]
pub struct EvaluationFigure {
    /// Names of the families; the last one stands for all.
    pub families: Vec<String>,
    /// Models and estimates.
    pub predictors: Vec<PredictorErrors>,
}

/// The errors of a model or an estimate.
#[derive(Clone, Debug)]
pub struct PredictorErrors {
    /// Its name.
    pub name: String,
    /// Root mean square error of a component in mm by family; `None` without predictions.
    pub rmse: Vec<Option<f64>>,
    /// Largest displacement of each pattern in mm: simulated and predicted.
    pub peaks: Vec<(f64, f64)>,
    /// Coefficient of determination of `peaks`.
    pub peak_r2: f64,
}

/// Charts beside each other, and the side of their frames.
const COLUMNS: usize = 4;
const SIDE: f64 = 216.0;

/// Height of a row of the matrix, and the space left of it and above it.
const ROW: f64 = 28.0;
const LEFT: f64 = 162.0;
const ABOVE: f64 = 58.0;

/// Letters that fit left of the matrix.
const NAME: usize = 24;

/// Points in a chart; more would only cover each other.
const MAX_POINTS: usize = 1500;

impl EvaluationFigure {
    /// Draws the largest displacement of each pattern, predicted over simulated, a chart for each predictor.
    pub fn charts(&self) -> Vec<Chart> {
        let peaks = self.predictors.iter().flat_map(|p| &p.peaks);
        let largest = peaks.fold(0.0, |l: f64, (a, b)| l.max(*a).max(*b));
        let end = if largest > 0.0 { 1.06 * largest } else { 1.0 };
        let chart = |predictor: &PredictorErrors| {
            let axis = |label: &str| Axis::linear(label, 0.0, end);
            let axes = [axis("Largest displacement, simulated [mm]"), axis("Predicted [mm]")];
            let n = predictor.peaks.len();
            let dots = predictor.peaks.iter().step_by(n.div_ceil(MAX_POINTS).max(1));
            let series = vec![
                Series::new("", Colour::Grey, Mark::Dashed, vec![(0.0, 0.0), (end, end)]),
                Series::new("", Colour::Blue, Mark::Cloud, dots.copied().collect()),
            ];
            let note = format!("R² {}, {n} patterns", r_squared(predictor.peak_r2));
            Chart::new(cut(&predictor.name, NAME), axes, series)
                .with_note(note)
                .square(SIDE)
        };
        let drawn = self.predictors.iter().filter(|p| !p.peaks.is_empty());
        drawn.map(chart).collect()
    }

    /// Returns the shade of an error: 0 for the smallest of all, 1 for the largest, on a logarithmic scale.
    pub fn shade(&self, error: f64) -> f64 {
        let all = self.predictors.iter().flat_map(|p| p.rmse.iter().flatten());
        let all = all.filter(|error| **error > 0.0);
        let (low, high) = extent(all, EMPTY);
        match error > 0.0 && high > low {
            true => (error / low).ln() / (high / low).ln(),
            false => 0.0,
        }
    }

    fn matrix(&self, width: f64) -> Sheet {
        let column = (width - LEFT - 14.0) / self.families.len() as f64;
        let left = |k: usize| LEFT + column * k as f64;
        let markup = html! {
            g.chart {
                text class="title" x="12" y="22" { "Root mean square error of a displacement component [mm]" }
                @for (k, family) in self.families.iter().enumerate() {
                    text class="ink" x=(left(k) + 0.5 * column) y=(ABOVE - 9.0) text-anchor="middle" { (family) }
                }
                @for (row, predictor) in self.predictors.iter().enumerate() {
                    @let y = ABOVE + ROW * row as f64;
                    text class="ink" x=(LEFT - 10.0) y=(y + 0.65 * ROW) text-anchor="end" {
                        (cut(&predictor.name, NAME))
                    }
                    @for (k, error) in predictor.rmse.iter().enumerate() { (self.cell([left(k), y, column], *error)) }
                }
            }
        };
        Sheet {
            size: [width, ABOVE + ROW * self.predictors.len() as f64 + 6.0],
            markup,
        }
    }

    fn cell(&self, [x, y, width]: [f64; 3], error: Option<f64>) -> Markup {
        let shade = error.map_or(0.0, |error| self.shade(error));
        let ink = ink_on(rgb(shade));
        html! {
            rect x=(x + 0.5) y=(y + 0.5) width=(width - 1.0) height=(ROW - 1.0) fill=(colour(shade)) {}
            text x=(x + 0.5 * width) y=(y + 0.65 * ROW) text-anchor="middle" style={ "fill:" (ink) } {
                (error.map_or("none".to_owned(), two_digits))
            }
        }
    }

    /// Draws the matrix of errors above one chart for each predictor.
    ///
    /// # Errors
    /// If there are no predictors or families, or errors are missing.
    pub fn sheet(&self) -> Result<Sheet, FigureError> {
        let fits = |p: &PredictorErrors| p.rmse.len() == self.families.len();
        if self.predictors.is_empty() || self.families.is_empty() || !self.predictors.iter().all(fits) {
            return Err(FigureError::Data(
                "an evaluation needs an error for each model and family".into(),
            ));
        }
        let charts = self.charts();
        let charts = Sheet::charts(COLUMNS.min(charts.len()), &charts);
        let width = (LEFT + 78.0 * self.families.len() as f64)
            .max(charts.size[0])
            .max(540.0);
        Ok(Sheet::below(vec![self.matrix(width), charts]))
    }
}

/// Returns a colour from pale blue for 0 to dark blue for 1.
fn rgb(shade: f64) -> [u8; 3] {
    let mix = |pale: f64, dark: f64| (pale + shade.clamp(0.0, 1.0) * (dark - pale)).round() as u8;
    [mix(236.0, 0.0), mix(244.0, 82.0), mix(250.0, 138.0)]
}

/// Returns the same colour as text.
fn colour(shade: f64) -> String {
    let [r, g, b] = rgb(shade);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Returns black or white, whichever has more contrast on a colour. One of them always has 4.5 : 1.
fn ink_on(ground: [u8; 3]) -> &'static str {
    match contrast(ground, [0; 3]) >= contrast(ground, [255; 3]) {
        true => "#000000",
        false => "#ffffff",
    }
}

/// Returns the contrast of two colours as the Web Content Accessibility Guidelines 2.2 define it.
fn contrast(a: [u8; 3], b: [u8; 3]) -> f64 {
    let luminance = |colour: [u8; 3]| {
        let linear = |value: u8| match f64::from(value) / 255.0 {
            v if v <= 0.04045 => v / 12.92,
            v => ((v + 0.055) / 1.055).powf(2.4),
        };
        0.2126 * linear(colour[0]) + 0.7152 * linear(colour[1]) + 0.0722 * linear(colour[2])
    };
    let (a, b) = (luminance(a), luminance(b));
    (a.max(b) + 0.05) / (a.min(b) + 0.05)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_readable_on_every_shade() {
        for step in 0..=100 {
            let ground = rgb(f64::from(step) / 100.0);
            let ink = if ink_on(ground) == "#ffffff" { [255; 3] } else { [0; 3] };
            assert!(contrast(ground, ink) >= 4.5, "{ground:?}");
        }
        // The largest contrast is 21 : 1.
        assert!((contrast([0; 3], [255; 3]) - 21.0).abs() < 1e-12);
    }

    #[test]
    fn small_errors_are_pale() {
        assert_eq!([0.0, 1.0].map(colour), ["#ecf4fa", "#00528a"]);
    }
}
