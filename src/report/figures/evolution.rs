//! How a design evolved, generation by generation.

use std::path::Path;

use super::axes::{Axis, line, panel};
use super::canvas::{FigureError, draw, palette, px};

/// One value per generation of each curve, the first population included.
#[derive(Clone, Debug)]
pub struct Evolution {
    /// Fitness of the best individual; smaller is better.
    pub best: Vec<f64>,
    /// Mean fitness of the population.
    pub mean: Vec<f64>,
    /// Predicted displacement of the best individual along the wanted direction, in mm.
    pub value: Vec<f64>,
    /// Electrode area of the best individual, a fraction of the membrane.
    pub area: Vec<f64>,
}

/// Draws the fitness of the best and of the mean individual, and displacement and area of the best, over the generations.
///
/// # Errors
/// When the curves are empty or differ in length, or the file cannot be written.
pub fn draw_evolution(path: &Path, data: &Evolution) -> Result<(), FigureError> {
    let n = data.best.len();
    if n == 0 || [data.mean.len(), data.value.len(), data.area.len()] != [n; 3] {
        return Err(FigureError::Data(
            "an evolution needs one value per generation each".into(),
        ));
    }
    draw(path, (1200, 1160), |sheet| {
        let parts = sheet.split_by_breakpoints::<u32, u32, _, _>([], [px(440), px(800)]);
        let x = || Axis::counting("Generation", 0.0, (n - 1).max(1) as f64);
        let all: Vec<f64> = data.best.iter().chain(&data.mean).copied().collect();
        let title = format!("Genetic algorithm, {} generations", n - 1);
        let entries = [("best", palette::BLUE), ("mean", palette::ORANGE)];
        let mut fitness = panel(
            &parts[0],
            &title,
            &entries,
            &x(),
            &around("Fitness (smaller is better)", &all),
        )?;
        line(&mut fitness, palette::BLUE, points(&data.best))?;
        line(&mut fitness, palette::ORANGE, points(&data.mean))?;

        let title = format!(
            "Predicted displacement of the best individual: {:.3} mm",
            data.value[n - 1]
        );
        let mut value = panel(&parts[1], &title, &[], &x(), &around("Displacement [mm]", &data.value))?;
        line(&mut value, palette::BLUE, points(&data.value))?;

        let percent: Vec<f64> = data.area.iter().map(|a| 100.0 * a).collect();
        let title = format!("Electrode area of the best individual: {:.1} %", percent[n - 1]);
        let mut area = panel(&parts[2], &title, &[], &x(), &around("Area [%]", &percent))?;
        line(&mut area, palette::GREEN, points(&percent))
    })
}

fn points(values: &[f64]) -> Vec<(f64, f64)> {
    values.iter().enumerate().map(|(i, v)| (i as f64, *v)).collect()
}

/// An axis with a margin around some values, so that a flat curve has an axis too.
fn around(label: &str, values: &[f64]) -> Axis {
    let (low, high) = bounds(values);
    Axis::linear(label, low, high)
}

fn bounds(values: &[f64]) -> (f64, f64) {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let margin = (0.08 * (high - low)).max(0.01 * high.abs()).max(1e-6);
    (low - margin, high + margin)
}
