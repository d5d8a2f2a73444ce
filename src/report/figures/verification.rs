//! Designs and the intuitive designs beside each other, simulated again on a finer mesh.

use std::path::Path;

use maud::html;

use super::membrane::electrode;
use crate::designs::LEAST_MM;
use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Membrane, Series, Sheet, exaggeration};
use crate::format::three;
use deaflow_pattern::Role;

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
    /// What it moves farther than the intuitive design at its own area, a share; none where nothing is compared.
    pub gain: Option<f64>,
    /// The least width of electrodes and gaps that was asked for; none where edges may be frayed.
    pub least_width: Option<String>,
}

/// Side of a membrane and height of the bars.
const SIDE: f64 = 262.0;
const BARS: f64 = 200.0;

/// Membranes in a row of a gallery, and the size of each with its caption.
const COLUMNS: usize = 8;
const TILE: [f64; 2] = [144.0, 198.0];

/// Draws each case deformed, what it gains, and how far its prediction was off.
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
    let drawn = |case: &Case| {
        let reached = format!("{:.4} mm, ", case.simulated);
        let chart = electrode(&case.name, &case.membrane, scale, SIDE);
        let note = reached + &chart.note;
        chart.with_note(note)
    };
    let electrodes: Vec<Chart> = cases.iter().map(drawn).collect();
    let membranes = Sheet::charts(cases.len(), &electrodes);
    let size = [(membranes.size[0] - 12.0).max(708.0), BARS];
    let charts = [gains(cases), residuals(cases)].into_iter().flatten();
    let charts = charts.map(|chart| Sheet::charts(1, &[chart.with_size(size)]));
    Sheet::below(std::iter::once(membranes).chain(charts).collect()).write_png(path)
}

/// What each design moves farther than the intuitive one; where nothing is compared with one, how far each moves.
fn gains(cases: &[Case]) -> Option<Chart> {
    match cases.iter().any(|case| case.gain.is_some()) {
        true => bars(
            "Gain over the intuitive design at its own area",
            "More displacement [%]",
            Colour::Blue,
            cases,
            |case| Some(100.0 * case.gain?),
        ),
        false => bars(
            "Simulated displacement",
            "Displacement [mm]",
            Colour::Blue,
            cases,
            |case| Some(case.simulated),
        ),
    }
}

/// What the evaluator predicted more or less than finite elements simulate.
fn residuals(cases: &[Case]) -> Option<Chart> {
    bars(
        "Predicted less simulated",
        "Difference [% of simulated]",
        Colour::Orange,
        cases,
        |case| {
            let simulated = Some(case.simulated).filter(|mm| mm.abs() > LEAST_MM)?;
            Some(100.0 * (case.predicted? - simulated) / simulated.abs())
        },
    )
}

/// A bar for each case that has a value, from zero and with the value at its end; none where none has one.
fn bars(title: &str, label: &str, colour: Colour, cases: &[Case], value: fn(&Case) -> Option<f64>) -> Option<Chart> {
    let known: Vec<(f64, f64)> = (0..)
        .map(f64::from)
        .zip(cases)
        .filter_map(|(k, case)| Some((k, value(case)?)))
        .collect();
    let corners = known.iter().flat_map(|(k, value)| [(k - 0.2, 0.0), (k + 0.2, *value)]);
    let words = known.iter().map(|(_, value)| three(*value)).collect();
    let series = Series::new("", colour, Mark::Bars, corners.collect()).with_words(words);
    let ends = known.iter().fold([0.0_f64; 2], |[low, high], (_, value)| {
        [low.min(*value), high.max(*value)]
    });
    // Numbers stand beyond the ends of the bars.
    let room = |end: f64| 0.25 * (ends[1] - ends[0]) * end.signum() * f64::from(u8::from(end != 0.0));
    let axes = [
        Axis::names(cases.iter().map(|c| c.name.clone()).collect()),
        Axis::linear(label, ends[0] + room(ends[0]), ends[1] + room(ends[1])),
    ];
    (!known.is_empty()).then(|| Chart::new(title, axes, vec![series]))
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
        let width = case
            .least_width
            .as_ref()
            .map_or("no min_feature".to_owned(), |width| format!("min_feature {width}"));
        Sheet {
            size: TILE,
            markup: html! {
                g.chart {
                    text class="ink" x="8" y="15" { (name) }
                    text class="ink" x="8" y="30" { (format!("{:.3} mm", case.simulated)) }
                    text x="8" y="45" { (width) }
                    g.membrane transform="translate(8 54) scale(0.128)" {
                        (membrane.ground().frame()) (membrane.electrode(scale)) (membrane.arrows(scale))
                    }
                }
            },
        }
    };
    Sheet::grid(COLUMNS, cases.iter().map(tile).collect()).write_png(path)
}
