//! Designs and intuitive designs, simulated on a finer mesh.

use maud::html;

use super::membrane::electrode;
use crate::designs::{LEAST_MM, quantity};
use crate::drawing::{Axis, Chart, Colour, DeformedMembrane, FigureError, Mark, Series, Sheet, exaggeration, extent};
use crate::format::{capitalised, mm, mm_measured, three};
use deaflow_base::rounded_by;
use deaflow_pattern::Role;

/// One pattern, predicted and simulated.
#[derive(Clone, Debug)]
pub struct VerifiedPattern {
    /// Its name.
    pub name: String,
    /// The pattern with its simulated field.
    pub membrane: DeformedMembrane,
    /// Predicted displacement of the point along the target direction, in mm; `None` without a prediction.
    pub predicted: Option<f64>,
    /// The same, simulated.
    pub simulated: f64,
    /// Its estimated error in mm, if known.
    pub error: Option<f64>,
    /// The unit of these values, which are forces of sides if it is mN.
    pub unit: &'static str,
    /// The required minimum width of electrodes and gaps, if there is one.
    pub least_width: Option<String>,
}

impl VerifiedPattern {
    /// Rounds the simulated displacement by its error, if that is known.
    fn rounded(&self) -> String {
        self.error
            .map_or_else(|| mm(self.simulated), |error| rounded_by(self.simulated, error))
    }
}

/// Side of a membrane, and height of the bars.
const SIDE: f64 = 262.0;
const BARS: f64 = 200.0;

/// Membranes in a row of a gallery, and the size of each with its text.
const COLUMNS: usize = 8;
const TILE: [f64; 2] = [144.0, 198.0];

/// Draws each pattern deformed, its simulated value, and the error of its prediction.
///
/// # Errors
/// If there are no patterns, or a displacement is not finite.
pub fn agreement_sheet(cases: &[VerifiedPattern]) -> Result<Sheet, FigureError> {
    if cases.is_empty()
        || cases
            .iter()
            .any(|c| !c.predicted.is_none_or(f64::is_finite) || !c.simulated.is_finite())
    {
        return Err(FigureError::Data(
            "a verification needs patterns with finite displacements".into(),
        ));
    }
    let scale = exaggeration(cases.iter().map(|case| &case.membrane));
    let drawn = |case: &VerifiedPattern| {
        let reached = format!("{} {}, ", mm_measured(case.simulated, case.error), case.unit);
        let chart = electrode(&case.name, &case.membrane, scale, SIDE);
        let note = reached + &chart.note;
        chart.with_note(note)
    };
    let electrodes: Vec<Chart> = cases.iter().map(drawn).collect();
    let membranes = Sheet::charts(cases.len(), &electrodes);
    let size = [(membranes.size[0] - 12.0).max(708.0), BARS];
    let charts = [displacements(cases), residuals(cases)].into_iter().flatten();
    let charts = charts.map(|chart| Sheet::charts(1, &[chart.with_size(size)]));
    Ok(Sheet::below(std::iter::once(membranes).chain(charts).collect()))
}

/// Draws the simulated values, which are those of the headline.
fn displacements(cases: &[VerifiedPattern]) -> Option<Chart> {
    let unit = cases.first()?.unit;
    let what = quantity(unit);
    bars(
        &format!("Simulated {what}"),
        &capitalised(&format!("{what} [{unit}]")),
        Colour::Blue,
        cases,
        |case| Some((case.simulated, case.rounded())),
    )
}

/// Draws the differences between prediction and simulation.
fn residuals(cases: &[VerifiedPattern]) -> Option<Chart> {
    bars(
        "Predicted minus simulated",
        "Difference [% of simulated]",
        Colour::Orange,
        cases,
        |case| {
            let simulated = Some(case.simulated).filter(|mm| mm.abs() > LEAST_MM)?;
            let difference = 100.0 * (case.predicted? - simulated) / simulated.abs();
            Some((difference, three(difference)))
        },
    )
}

/// Draws a bar for each pattern, with its value at its end, and a word in place of a bar without a value; `None` if no
/// pattern has one. `value` is the height of a bar and its text.
fn bars(
    title: &str,
    label: &str,
    colour: Colour,
    cases: &[VerifiedPattern],
    value: fn(&VerifiedPattern) -> Option<(f64, String)>,
) -> Option<Chart> {
    let found: Vec<Option<(f64, String)>> = cases.iter().map(value).collect();
    let known: Vec<f64> = found.iter().flatten().map(|(height, _)| *height).collect();
    let drawn = found.into_iter().map(|one| one.unwrap_or((0.0, NONE.to_owned())));
    let (heights, texts): (Vec<f64>, Vec<String>) = drawn.unzip();
    let places = (0..).map(f64::from).zip(&heights);
    let corners = places.flat_map(|(k, height)| [(k - 0.2, 0.0), (k + 0.2, *height)]);
    let series = Series::new("", colour, Mark::Bars, corners.collect()).with_texts(texts);
    let (low, high) = extent(&known, (0.0, 0.0));
    // The numbers are beyond the ends of the bars.
    let space = |end: f64| 0.25 * (high - low) * end.signum() * f64::from(u8::from(end != 0.0));
    let axes = [
        Axis::names(cases.iter().map(|c| c.name.clone()).collect()),
        Axis::linear(label, low + space(low), high + space(high)),
    ];
    (!known.is_empty()).then(|| Chart::new(title, axes, vec![series]))
}

/// What stands in place of a bar without a value.
const NONE: &str = "none";

/// Draws each design deformed with its displacement, row by row, with the same exaggeration.
///
/// # Errors
/// If there are no designs, or a displacement is not finite.
pub fn gallery_sheet(cases: &[VerifiedPattern]) -> Result<Sheet, FigureError> {
    if cases.is_empty() || cases.iter().any(|case| !case.simulated.is_finite()) {
        return Err(FigureError::Data(
            "a gallery needs designs with finite displacements".into(),
        ));
    }
    let scale = exaggeration(cases.iter().map(|case| &case.membrane));
    let tile = |case: &VerifiedPattern| {
        // The role is left out, except for own patterns, which are beside the designs of their target.
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
                    text class="ink" x="8" y="30" { (case.rounded()) " " (case.unit) }
                    text x="8" y="45" { (width) }
                    g.membrane transform="translate(8 54) scale(0.128)" {
                        (membrane.background().draw_frame()) (membrane.electrode(scale))
                        (membrane.sides(scale)) (membrane.arrows(scale))
                    }
                }
            },
        }
    };
    Ok(Sheet::grid(COLUMNS, cases.iter().map(tile).collect()))
}
