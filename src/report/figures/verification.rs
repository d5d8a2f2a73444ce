//! Designs and the intuitive designs beside each other, simulated again on a finer mesh.

use std::path::Path;

use maud::html;

use super::membrane::electrode;
use crate::pattern::Role;
use crate::report::drawing::{Axis, Chart, Colour, FigureError, Mark, Membrane, Series, Sheet, exaggeration};

/// One pattern, predicted and simulated.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// The pattern with its simulated field.
    pub membrane: Membrane,
    /// Predicted displacement of the wanted point along the wanted direction, in mm; none where nothing was predicted.
    pub predicted: Option<f64>,
    /// The same, simulated.
    pub simulated: f64,
}

/// Side of a membrane and height of the bars.
const SIDE: f64 = 262.0;
const BARS: f64 = 246.0;

/// Membranes in a row of a gallery, and the size of each with its caption.
const COLUMNS: usize = 8;
const TILE: [f64; 2] = [144.0, 180.0];

/// Draws each case deformed, and its predicted and simulated displacements beside each other.
///
/// # Errors
/// When there are no cases or data are incomplete, or the file cannot be written.
pub fn draw_agreement(path: &Path, cases: &[Case]) -> Result<(), FigureError> {
    if cases.is_empty()
        || cases
            .iter()
            .any(|c| !c.predicted.is_none_or(f64::is_finite) || !c.simulated.is_finite())
    {
        return Err(FigureError::Data(
            "a verification needs cases with finite displacements".into(),
        ));
    }
    let scale = exaggeration(cases.iter().map(|case| &case.membrane));
    let electrodes: Vec<Chart> = cases
        .iter()
        .map(|case| electrode(&case.name, &case.membrane, scale, SIDE))
        .collect();
    let membranes = Sheet::charts(cases.len(), &electrodes);
    let bars = bars(cases).with_size([(membranes.size[0] - 12.0).max(708.0), BARS]);
    Sheet::below(vec![membranes, Sheet::charts(1, &[bars])]).write_png(path)
}

fn bars(cases: &[Case]) -> Chart {
    let values = cases.iter().flat_map(|c| [c.predicted, Some(c.simulated)]);
    let values: Vec<f64> = values.flatten().collect();
    let x = Axis::names(cases.iter().map(|c| c.name.clone()).collect());
    let series = |name: &str, colour, side: f64, value: fn(&Case) -> Option<f64>| {
        let known = (0..)
            .map(f64::from)
            .zip(cases)
            .filter_map(|(k, case)| Some((k, value(case)?)));
        let corners = known.clone().flat_map(|(k, value)| {
            let left = k + side;
            [(left, 0.0), (left + 0.3, value)]
        });
        let words = known.clone().map(|(_, value)| format!("{value:.3}")).collect();
        Series::new(name, colour, Mark::Bars, corners.collect()).with_words(words)
    };
    let series = vec![
        series("predicted by the evaluator", Colour::Sky, -0.32, |case| case.predicted),
        series("simulated by finite elements", Colour::Blue, 0.02, |case| {
            Some(case.simulated)
        }),
    ];
    let axes = [x, Axis::above("Displacement [mm]", &values)];
    Chart::new("Displacement along the wanted direction", axes, series)
}

/// Draws each design deformed with what it reaches, row by row, displacements exaggerated alike.
///
/// # Errors
/// When there are no designs or data are incomplete, or the file cannot be written.
pub fn draw_gallery(path: &Path, cases: &[Case]) -> Result<(), FigureError> {
    if cases.is_empty() || cases.iter().any(|case| !case.simulated.is_finite()) {
        return Err(FigureError::Data(
            "a gallery needs designs with finite displacements".into(),
        ));
    }
    let scale = exaggeration(cases.iter().map(|case| &case.membrane));
    let tile = |case: &Case| {
        // A person's own pattern is beside the designs of its target, which are not told by their roles.
        let name = match case.name.split_once(": ") {
            Some((name, role)) if role != Role::Own.name() => name,
            _ => case.name.as_str(),
        };
        let membrane = &case.membrane;
        Sheet {
            size: TILE,
            markup: html! {
                g.chart {
                    text class="ink" x="8" y="15" { (name) }
                    text class="ink" x="8" y="30" { (format!("{:.3} mm", case.simulated)) }
                    g.membrane transform="translate(8 40) scale(0.128)" {
                        (membrane.ground().frame()) (membrane.electrode(scale)) (membrane.arrows(scale))
                    }
                }
            },
        }
    };
    Sheet::grid(COLUMNS, cases.iter().map(tile).collect()).write_png(path)
}
