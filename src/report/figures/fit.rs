//! Measured curves beside fitted laws.

use crate::drawing::{Axis, Chart, Colour, FigureError, LARGE, Mark, Series, Sheet};

/// A measured curve beside the fitted one.
#[derive(Clone, Debug)]
pub struct FittedCurve {
    /// Its name.
    pub name: String,
    /// The measured points.
    pub measured: Vec<(f64, f64)>,
    /// The fitted curve.
    pub fitted: Vec<(f64, f64)>,
}

/// A measured curve beside those of several laws that were compared.
#[derive(Clone, Debug)]
pub struct ComparedCurve {
    /// Its name.
    pub name: String,
    /// The measured points.
    pub measured: Vec<(f64, f64)>,
    /// The curve of each law with its name, the chosen one first.
    pub laws: Vec<(String, Vec<(f64, f64)>)>,
}

/// The colours of laws that were not chosen, as solid lines, then as dashed ones.
const OTHERS: [Colour; 5] = [
    Colour::Orange,
    Colour::Green,
    Colour::Vermillion,
    Colour::Purple,
    Colour::Sky,
];

/// Draws measured points as dots and the fitted curves as lines, each pair in one colour.
///
/// # Errors
/// If there is no point, or a number is not finite.
pub fn fit_sheet(title: &str, labels: [&str; 2], curves: &[FittedCurve]) -> Result<Sheet, FigureError> {
    let series = Series::coloured(curves).flat_map(|(curve, colour)| {
        [
            Series::new("", colour, Mark::Line, curve.fitted.clone()),
            Series::new(&curve.name, colour, Mark::Dots, curve.measured.clone()),
        ]
    });
    Ok(Sheet::charts(1, &[chart(title, labels, [false; 2], series.collect())?]))
}

/// Draws a chart for each measured curve, two in a row: its points as dots, the chosen law as a wide line, the others
/// as thin ones. The axes show all of the points and of the chosen law.
///
/// # Errors
/// If there is no point, or a number is not finite.
pub fn compared_laws_sheet(labels: [&str; 2], curves: &[ComparedCurve]) -> Result<Sheet, FigureError> {
    let charts = curves.iter().map(|curve| {
        let measured = Series::new("measured", Colour::Grey, Mark::Dots, curve.measured.clone());
        let Some(((name, chosen), others)) = curve.laws.split_first() else {
            return chart(&curve.name, labels, [false; 2], vec![measured]);
        };
        let chosen = Series::new(name, Colour::Blue, Mark::Wide, chosen.clone());
        let marks = [Mark::Thin, Mark::Dashed].into_iter().cycle();
        let styles = marks.flat_map(|mark| OTHERS.map(|colour| (mark, colour)));
        let others = others.iter().zip(styles);
        let others = others.map(|((name, points), (mark, colour))| Series::new(name, colour, mark, points.clone()));
        let mut drawn = chart(&curve.name, labels, [false; 2], vec![chosen, measured])?;
        // Thin lines over the wide one, which would hide them, and points over all.
        drawn.series.splice(1..1, others);
        Ok(drawn)
    });
    let charts: Vec<Chart> = charts.collect::<Result<_, FigureError>>()?;
    match charts.is_empty() {
        true => Err(FigureError::Data("there is nothing to draw".into())),
        false => Ok(Sheet::charts(charts.len().min(2), &charts)),
    }
}

/// Draws a measured curve as dots beside the simulated one as a line, on axes that may be logarithmic.
///
/// # Errors
/// If there is no point, or a number is not finite.
pub(super) fn curve_chart(
    curve: &FittedCurve,
    labels: [&str; 2],
    logarithmic: [bool; 2],
) -> Result<Chart, FigureError> {
    let mut series = vec![Series::new(
        "measured",
        Colour::Blue,
        Mark::Dots,
        curve.measured.clone(),
    )];
    if !curve.fitted.is_empty() {
        let simulated = Series::new("simulated", Colour::Vermillion, Mark::Line, curve.fitted.clone());
        // Dots are drawn over the line.
        series.insert(0, simulated);
    }
    chart(&curve.name, labels, logarithmic, series)
}

/// Creates a chart with axes that show all points.
fn chart(title: &str, labels: [&str; 2], logarithmic: [bool; 2], series: Vec<Series>) -> Result<Chart, FigureError> {
    let points = || series.iter().flat_map(|series| &series.points);
    if points().next().is_none() || points().any(|(x, y)| !x.is_finite() || !y.is_finite()) {
        return Err(FigureError::Data("a fit needs points with finite numbers".into()));
    }
    let (across, up): (Vec<f64>, Vec<f64>) = points().copied().unzip();
    let axis = |at: usize, values: &[f64]| match logarithmic[at] {
        true => Axis::logarithmic(labels[at], values),
        false => Axis::between(labels[at], values),
    };
    let axes = [axis(0, &across), axis(1, &up)];
    Ok(Chart::new(title, axes, series).with_size(LARGE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_law_is_drawn_and_the_chosen_one_stands_out() {
        let line = |high: f64| vec![(1.0, 0.0), (2.0, high)];
        let curve = ComparedCurve {
            name: "uniaxial.csv".into(),
            measured: line(1.0),
            laws: vec![
                ("gent, chosen".into(), line(1.1)),
                ("yeoh, AICc +3.400".into(), line(1.2)),
                ("far off".into(), line(1e6)),
            ],
        };
        let text = compared_laws_sheet(["stretch", "stress"], &[curve])
            .unwrap()
            .markup
            .into_string();
        for (name, times) in [
            ("gent, chosen", 1),
            ("yeoh, AICc +3.400", 1),
            ("stroke-width:36", 1),
            ("stroke-width:13", 2),
        ] {
            assert_eq!(text.matches(name).count(), times, "{name}: {text}");
        }
        assert!(
            !text.contains("1000000"),
            "a law far off does not change the axis: {text}"
        );
        assert!(compared_laws_sheet(["x", "y"], &[]).is_err());
    }
}
