//! Accuracy and cost: the error of each method over its time, for each family of patterns.

use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};
use crate::format::number;

/// The methods, measured on one family of patterns.
#[derive(Clone, Debug)]
pub struct FamilyCosts {
    /// Name of the family.
    pub family: String,
    /// One for each method that has an error and a time.
    pub costs: Vec<Cost>,
}

/// Error and time of a method.
#[derive(Clone, Debug)]
pub struct Cost {
    /// The settings of the method: `method: linear, elements_per_cell: 2, order: 1`.
    pub settings: String,
    /// Seconds of one core per pattern.
    pub seconds: f64,
    /// Root mean square error of a component in mm.
    pub error: f64,
}

/// Charts beside each other.
const COLUMNS: usize = 3;

/// How a method is drawn: parts of its settings, its name in the legend, and a colour. The first match counts.
type Group = (&'static [&'static str], &'static str, Colour);

const GROUPS: [Group; 11] = [
    (&["method: linear"], "linear response", Colour::Vermillion),
    (&["method: chord"], "chord steps", Colour::Orange),
    (
        &["method: newton", "accuracy:"],
        "Newton, mesh by accuracy",
        Colour::Green,
    ),
    (&["method: newton", "order: 1"], "Newton, bilinear", Colour::Sky),
    (&["method: newton", "order: 2"], "Newton, biquadratic", Colour::Blue),
    (&["method: creep:3+"], "creep from 3 estimates", Colour::Orange),
    (&["method: creep:3"], "creep from 3 solutions", Colour::Green),
    (&["method: history+"], "estimated steps", Colour::Sky),
    (&["method: history"], "all steps", Colour::Blue),
    (&["network:"], "surrogates", Colour::Purple),
    (&[], "other", Colour::Grey),
];

impl Cost {
    fn group(&self) -> &'static Group {
        let fits = |group: &&Group| group.0.iter().all(|part| self.settings.contains(part));
        GROUPS.iter().find(fits).unwrap_or(&GROUPS[GROUPS.len() - 1])
    }

    /// Whether it can be shown on logarithmic axes.
    fn is_drawn(&self) -> bool {
        self.error > 0.0 && self.seconds > 0.0
    }

    /// Returns a short label; the legend has the rest.
    fn label(&self) -> String {
        let value = |key: &str| {
            let pairs = self.settings.split(", ").filter_map(|pair| pair.split_once(": "));
            pairs.into_iter().find(|(k, _)| *k == key).map(|(_, v)| v.to_owned())
        };
        if let Some(network) = value("network") {
            return network;
        }
        let method = value("method")
            .filter(|m| m != "newton")
            .map_or(String::new(), |m| format!("{m}, "));
        match (value("elements_per_cell"), value("order"), value("accuracy")) {
            (Some(elements), Some(order), _) => format!("{method}{elements}² Q{order}"),
            (_, _, Some(accuracy)) => format!("{method}{accuracy}"),
            _ => self.settings.clone(),
        }
    }
}

/// Returns the positions of the points that no other point beats in both coordinates, from left to right.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (points[a], points[b]);
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut least = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < least;
        least = least.min(points[i].1);
        better
    });
    order
}

/// Draws the error of each method over its time, a chart for each family with its Pareto front; all charts have the
/// same axes.
///
/// # Errors
/// If no method has an error and a time.
pub fn accuracy_charts(families: &[FamilyCosts]) -> Result<Vec<Chart>, FigureError> {
    let costs = families.iter().flat_map(|family| &family.costs);
    let drawn: Vec<&Cost> = costs.filter(|cost| cost.is_drawn()).collect();
    if drawn.is_empty() {
        return Err(FigureError::Data("no method has both an error and a time".into()));
    }
    let times: Vec<f64> = drawn.iter().map(|cost| 1e3 * cost.seconds).collect();
    let largest = drawn.iter().map(|cost| cost.error).fold(0.0, f64::max);
    // Labels need space above the highest point.
    let errors: Vec<f64> = drawn.iter().map(|cost| cost.error).chain([3.0 * largest]).collect();
    let x = Axis::logarithmic("Time of one core per pattern [ms]", &times);
    let y = Axis::logarithmic("RMS error of a component [mm]", &errors);
    let chart = |family: &FamilyCosts| Chart::new(family.family.clone(), [x.clone(), y.clone()], series(family));
    Ok(families.iter().map(chart).collect())
}

fn series(family: &FamilyCosts) -> Vec<Series> {
    let costs: Vec<&Cost> = family.costs.iter().filter(|cost| cost.is_drawn()).collect();
    let points: Vec<(f64, f64)> = costs.iter().map(|c| (1e3 * c.seconds, c.error)).collect();
    let front = pareto_front(&points);
    let best: Vec<(f64, f64)> = front.iter().map(|&k| points[k]).collect();
    let labels = front.iter().map(|&k| costs[k].label()).collect();
    let mut series = vec![Series::new("", Colour::Grey, Mark::Dashed, best.clone())];
    for (_, name, colour) in GROUPS {
        let own: Vec<usize> = (0..costs.len()).filter(|k| costs[*k].group().1 == name).collect();
        if own.is_empty() {
            continue;
        }
        let texts = own.iter().map(|&k| {
            let (time, error) = points[k];
            format!("{}: {} ms, {} mm", costs[k].settings, number(time), number(error))
        });
        let texts = texts.collect();
        let dots = own.iter().map(|&k| points[k]).collect();
        series.push(Series::new(name, colour, Mark::Dots, dots).with_texts(texts));
    }
    series.push(Series::new("", Colour::Grey, Mark::Labelled, best).with_texts(labels));
    series
}

/// Draws the charts on a sheet.
///
/// # Errors
/// If no method has an error and a time.
pub fn accuracy_sheet(families: &[FamilyCosts]) -> Result<Sheet, FigureError> {
    let charts = accuracy_charts(families)?;
    Ok(Sheet::charts(COLUMNS.min(charts.len()), &charts))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_has_the_points_that_no_other_beats() {
        let points = [(3.0, 1.0), (1.0, 5.0), (2.0, 5.0), (2.0, 2.0), (4.0, 1.0), (1.0, 6.0)];
        assert_eq!(pareto_front(&points), [1, 3, 0]);
        assert!(pareto_front(&[]).is_empty());
    }

    #[test]
    fn labels_have_what_the_legend_does_not() {
        for (settings, label, group) in [
            (
                "method: linear, elements_per_cell: 2, order: 1",
                "linear, 2² Q1",
                "linear response",
            ),
            (
                "method: chord:4, elements_per_cell: 1, order: 2",
                "chord:4, 1² Q2",
                "chord steps",
            ),
            (
                "method: newton, elements_per_cell: 8, order: 2",
                "8² Q2",
                "Newton, biquadratic",
            ),
            (
                "method: newton, accuracy: 0.01 mm",
                "0.01 mm",
                "Newton, mesh by accuracy",
            ),
            ("network: qin2024", "qin2024", "surrogates"),
            ("network: qin2024, model: 0123456789ab", "qin2024", "surrogates"),
            ("settings: unheard of", "settings: unheard of", "other"),
        ] {
            let cost = Cost {
                settings: settings.into(),
                seconds: 1.0,
                error: 1.0,
            };
            assert_eq!((cost.label().as_str(), cost.group().1), (label, group));
        }
    }
}
