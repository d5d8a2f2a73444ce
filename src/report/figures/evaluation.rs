//! Models beside estimates: the error of each on each family, and the largest displacement as predicted and as simulated.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{Axis, square};
use super::canvas::{Area, FigureError, draw, palette, px, text};

/// What an evaluation found.
#[derive(Clone, Debug)]
pub struct Evaluated {
    /// Names of the families, the last for all together.
    pub families: Vec<String>,
    /// Models and estimates.
    pub predictors: Vec<EvaluatedPredictor>,
}

/// A model or an estimate.
#[derive(Clone, Debug)]
pub struct EvaluatedPredictor {
    /// Its name.
    pub name: String,
    /// Root mean square error of a component in mm by family; none where nothing was predicted.
    pub rmse: Vec<Option<f64>>,
    /// Largest displacement of each pattern in mm, simulated and predicted.
    pub peaks: Vec<(f64, f64)>,
    /// Coefficient of determination of these.
    pub peak_r2: f64,
}

/// Scatter plots beside each other.
const COLUMNS: usize = 4;

/// Height of a row of the matrix in pixels.
const ROW: u32 = 46;

/// Points in one scatter plot: more only cover each other.
const MOST_POINTS: usize = 4000;

/// Draws the matrix of errors above one scatter plot for each model or estimate.
///
/// # Errors
/// When the numbers do not fit together, or the file cannot be written.
pub fn draw_evaluation(path: &Path, data: &Evaluated) -> Result<(), FigureError> {
    let fits = |p: &EvaluatedPredictor| p.rmse.len() == data.families.len();
    if data.predictors.is_empty() || data.families.is_empty() || !data.predictors.iter().all(fits) {
        return Err(FigureError::Data(
            "an evaluation needs an error for each model and family".into(),
        ));
    }
    let columns = COLUMNS.min(data.predictors.len());
    let rows = data.predictors.len().div_ceil(columns);
    let width = (300 + 130 * data.families.len() as u32)
        .max(460 * columns as u32)
        .max(900);
    let head = 120 + ROW * data.predictors.len() as u32;
    draw(path, (width, head + 480 * rows as u32), |sheet| {
        let (upper, lower) = sheet.split_vertically(px(head));
        matrix(&upper, data)?;
        let largest = data
            .predictors
            .iter()
            .flat_map(|p| &p.peaks)
            .fold(0.0, |l: f64, (a, b)| l.max(*a).max(*b));
        for (area, predictor) in lower.split_evenly((rows, columns)).iter().zip(&data.predictors) {
            scatter(area, predictor, largest)?;
        }
        Ok(())
    })
}

fn matrix(area: &Area<'_>, data: &Evaluated) -> Result<(), FigureError> {
    let (width, _) = area.dim_in_pixel();
    let style = |size, colour| text(size, colour).pos(Pos::new(HPos::Center, VPos::Center));
    let title = "Root mean square error of a displacement component [mm]";
    area.draw(&Text::new(
        title,
        ((width / 2) as i32, px(26) as i32),
        style(26, palette::INK),
    ))?;
    let (left, top) = (px(270) as i32, px(96) as i32);
    let column = (width as i32 - left - px(24) as i32) / data.families.len() as i32;
    let middle = |k: usize| left + column * k as i32 + column / 2;
    for (k, family) in data.families.iter().enumerate() {
        area.draw(&Text::new(
            family.clone(),
            (middle(k), top - px(22) as i32),
            style(19, palette::INK),
        ))?;
    }
    let shown = data
        .predictors
        .iter()
        .flat_map(|p| p.rmse.iter().flatten())
        .filter(|e| **e > 0.0);
    let (low, high) = shown.fold((f64::INFINITY, 0.0f64), |(l, h), e| (l.min(*e), h.max(*e)));
    for (row, predictor) in data.predictors.iter().enumerate() {
        let y = top + px(ROW) as i32 * row as i32;
        let name = text(20, palette::INK).pos(Pos::new(HPos::Right, VPos::Center));
        let centre = y + px(ROW / 2) as i32;
        area.draw(&Text::new(cut(&predictor.name), (left - px(16) as i32, centre), name))?;
        for (k, error) in predictor.rmse.iter().enumerate() {
            let share = match error {
                Some(error) if high > low && *error > 0.0 => (error / low).ln() / (high / low).ln(),
                _ => 0.0,
            };
            let x = left + column * k as i32;
            let gap = px(1) as i32;
            let corners = [(x + gap, y + gap), (x + column - gap, y + px(ROW) as i32 - gap)];
            area.draw(&Rectangle::new(corners, shade(share).filled()))?;
            let colour = if share > 0.5 { WHITE } else { palette::INK };
            let words = error.map_or("none".to_owned(), written);
            area.draw(&Text::new(words, (middle(k), centre), style(20, colour)))?;
        }
    }
    Ok(())
}

/// A name that fits beside the matrix.
fn cut(name: &str) -> String {
    const LONGEST: usize = 24;
    match name.chars().count() > LONGEST {
        true => name.chars().take(LONGEST - 1).chain(['…']).collect(),
        false => name.to_owned(),
    }
}

/// Two significant digits.
fn written(value: f64) -> String {
    let digits = if value > 0.0 {
        (1.0 - value.log10().floor()).clamp(1.0, 6.0)
    } else {
        1.0
    };
    format!("{value:.*}", digits as usize)
}

/// From pale to dark blue: small errors are pale.
fn shade(share: f64) -> RGBColor {
    let mix = |pale: f64, dark: f64| (pale + share.clamp(0.0, 1.0) * (dark - pale)).round() as u8;
    RGBColor(mix(236.0, 0.0), mix(244.0, 82.0), mix(250.0, 138.0))
}

fn scatter(area: &Area<'_>, predictor: &EvaluatedPredictor, largest: f64) -> Result<(), FigureError> {
    let end = if largest > 0.0 { 1.06 * largest } else { 1.0 };
    let [x, y] = ["Largest displacement, simulated [mm]", "Predicted [mm]"].map(|label| Axis::linear(label, 0.0, end));
    let note = match predictor.peaks.len() {
        0 => "no predictions".to_owned(),
        n => format!("R² {:.5}, {n} patterns", predictor.peak_r2),
    };
    let mut panel = square(area, &cut(&predictor.name), &note, [&x, &y])?;
    panel.draw_series(LineSeries::new(
        [(0.0, 0.0), (end, end)],
        palette::GREY.stroke_width(px(1)),
    ))?;
    let step = predictor.peaks.len().div_ceil(MOST_POINTS).max(1);
    let dots = predictor.peaks.iter().step_by(step);
    panel.draw_series(dots.map(|at| Circle::new(*at, px(2), palette::BLUE.mix(0.6).filled())))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_numbers_keep_two_digits() {
        let texts = [0.0, 0.0031, 0.00052, 0.061, 1.26].map(written);
        assert_eq!(texts, ["0.0", "0.0031", "0.00052", "0.061", "1.3"]);
        assert_eq!(cut("a_name_that_is_much_too_long_for_a_row").chars().count(), 24);
        assert_eq!(shade(0.0), RGBColor(236, 244, 250));
        assert_eq!(shade(1.0), RGBColor(0, 82, 138));
    }
}
