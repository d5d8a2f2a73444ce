//! The history of a genetic algorithm, generation by generation.

use crate::designs::quantity;
use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};
use crate::format::{capitalised, mm};

/// One value per generation of each curve, including the first population.
#[derive(Clone, Debug)]
pub struct Evolution {
    /// Fitness of the best individual; smaller is better.
    pub best: Vec<f64>,
    /// Mean fitness of the population.
    pub mean: Vec<f64>,
    /// Predicted displacement of the best individual along the target direction, in mm.
    pub value: Vec<f64>,
    /// Its unit: that of forces of sides is mN.
    pub unit: &'static str,
    /// Electrode area of the best individual, a share of the free membrane.
    pub area: Vec<f64>,
}

/// Width of a chart, and heights of the first and of the other charts.
const WIDTH: f64 = 716.0;
const HIGH: f64 = 250.0;
const LOW: f64 = 190.0;

/// Draws the fitness of the best and of the mean individual, and displacement and area of the best, over the
/// generations.
///
/// # Errors
/// If the curves are empty or differ in length.
pub fn evolution_sheet(data: &Evolution) -> Result<Sheet, FigureError> {
    let n = data.best.len();
    if n == 0 || [data.mean.len(), data.value.len(), data.area.len()] != [n; 3] {
        return Err(FigureError::Data(
            "the curves of a genetic algorithm need one value per generation".into(),
        ));
    }
    let chart = |title: String, label: &str, curves: &[(&str, Colour, &[f64])], height: f64| {
        let x = Axis::counting("Generation", 0.0, (n - 1).max(1) as f64);
        let y = Axis::between(label, curves.iter().flat_map(|(_, _, values)| values.iter()));
        let series = curves.iter().map(|(name, colour, values)| {
            let points = values.iter().enumerate().map(|(i, v)| (i as f64, *v)).collect();
            Series::new(name, *colour, Mark::LineAndDots, points)
        });
        let chart = Chart::new(title, [x, y], series.collect()).with_size([WIDTH, height]);
        Sheet::charts(1, &[chart])
    };
    let what = quantity(data.unit);
    let percent: Vec<f64> = data.area.iter().map(|a| 100.0 * a).collect();
    Ok(Sheet::below(vec![
        chart(
            format!("Genetic algorithm, {} generations", n - 1),
            "Fitness (smaller is better)",
            &[("best", Colour::Blue, &data.best), ("mean", Colour::Orange, &data.mean)],
            HIGH,
        ),
        chart(
            format!(
                "Predicted {what} of the best individual: {} {}",
                mm(data.value[n - 1]),
                data.unit
            ),
            &capitalised(&format!("{what} [{}]", data.unit)),
            &[("", Colour::Blue, &data.value)],
            LOW,
        ),
        chart(
            format!("Electrode area of the best individual: {:.1} %", percent[n - 1]),
            "Area [%]",
            &[("", Colour::Green, &percent)],
            LOW,
        ),
    ]))
}
