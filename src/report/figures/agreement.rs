//! The design and the intuitive designs, simulated again on a finer mesh.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{Axis, panel};
use super::canvas::{Area, FigureError, draw, palette, px, text};
use super::membrane::{Membrane, electrode, exaggeration};

/// One pattern, predicted and simulated.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// The pattern with its simulated field.
    pub membrane: Membrane,
    /// Predicted displacement of the wanted point along the wanted direction, in mm.
    pub predicted: f64,
    /// The same, simulated.
    pub simulated: f64,
}

/// Draws each case deformed, and its predicted and simulated displacements beside each other.
///
/// # Errors
/// When there are no cases or data are incomplete, or the file cannot be written.
pub fn draw_agreement(path: &Path, cases: &[Case]) -> Result<(), FigureError> {
    cases.iter().try_for_each(|case| case.membrane.validate())?;
    if cases.is_empty()
        || cases
            .iter()
            .any(|c| !c.predicted.is_finite() || !c.simulated.is_finite())
    {
        return Err(FigureError::Data(
            "a verification needs cases with finite displacements".into(),
        ));
    }
    let width = 560 * cases.len() as u32;
    draw(path, (width, 1010), |sheet| {
        let (upper, lower) = sheet.split_vertically(px(600));
        let membranes: Vec<&Membrane> = cases.iter().map(|c| &c.membrane).collect();
        let scale = exaggeration(&membranes);
        for (part, case) in upper.split_evenly((1, cases.len())).iter().zip(cases) {
            electrode(part, &case.name, &case.membrane, scale)?;
        }
        bars(&lower, cases)
    })
}

/// A name for the legend, a colour, where the bar begins beside its tick, and its height.
type Series = (&'static str, RGBColor, f64, fn(&Case) -> f64);

const SERIES: [Series; 2] = [
    ("predicted by the evaluator", palette::SKY, -0.32, |case| case.predicted),
    ("simulated by finite elements", palette::BLUE, 0.02, |case| {
        case.simulated
    }),
];

fn bars(area: &Area<'_>, cases: &[Case]) -> Result<(), FigureError> {
    let values: Vec<f64> = cases.iter().flat_map(|c| [c.predicted, c.simulated]).collect();
    let y = Axis::above("Displacement [mm]", &values);
    let x = Axis::names(cases.iter().map(|c| c.name.clone()).collect());
    let entries = SERIES.map(|(name, colour, _, _)| (name, colour));
    let mut panel = panel(area, "Displacement along the wanted direction", &entries, &x, &y)?;
    for (_, colour, side, value) in SERIES {
        let place = |k: usize| k as f64 + side;
        let bar = |(k, case)| Rectangle::new([(place(k), 0.0), (place(k) + 0.3, value(case))], colour.filled());
        panel.draw_series(cases.iter().enumerate().map(bar))?;
        panel.draw_series(cases.iter().enumerate().map(|(k, case)| {
            let anchor = if value(case) < 0.0 { VPos::Top } else { VPos::Bottom };
            let style = text(20, palette::INK).pos(Pos::new(HPos::Center, anchor));
            Text::new(format!("{:.3}", value(case)), (place(k) + 0.15, value(case)), style)
        }))?;
    }
    Ok(())
}
