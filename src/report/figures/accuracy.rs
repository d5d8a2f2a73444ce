//! What accuracy costs: the error of each method over its time, for each family of patterns.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{Axis, Entry, Panel, legend, panel};
use super::canvas::{Area, FigureError, draw, palette, px, text};
use super::labels::{Labels, Spot};

/// The methods on one family of patterns.
#[derive(Clone, Debug)]
pub struct FamilyCosts {
    /// Name of the family.
    pub family: String,
    /// One for each method that has both.
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

/// Panels beside each other.
const COLUMNS: usize = 3;

/// What a method is drawn as: the start of its settings, its name in the legend, and a colour. The first that fits counts.
type Group = (&'static [&'static str], &'static str, RGBColor);

const GROUPS: [Group; 7] = [
    (&["method: linear"], "linear response", palette::VERMILLION),
    (&["method: chord"], "chord steps", palette::ORANGE),
    (
        &["method: newton", "accuracy:"],
        "Newton, mesh by accuracy",
        palette::GREEN,
    ),
    (&["method: newton", "order: 1"], "Newton, bilinear", palette::SKY),
    (&["method: newton", "order: 2"], "Newton, biquadratic", palette::BLUE),
    (&["network:"], "surrogates", palette::PURPLE),
    (&[], "other", palette::GREY),
];

impl Cost {
    /// What the method is drawn as: its place among [`Cost::kinds`].
    pub(in crate::report) fn kind(&self) -> usize {
        GROUPS
            .iter()
            .position(|group| group.1 == self.group().1)
            .unwrap_or(GROUPS.len() - 1)
    }

    /// What methods are drawn as, for a legend.
    pub(in crate::report) fn kinds() -> impl Iterator<Item = &'static str> {
        GROUPS.iter().map(|group| group.1)
    }

    fn group(&self) -> &'static Group {
        let fits = |group: &&Group| group.0.iter().all(|part| self.settings.contains(part));
        GROUPS.iter().find(fits).unwrap_or(&GROUPS[GROUPS.len() - 1])
    }

    /// A few words beside the point: the legend says the rest.
    pub(in crate::report) fn label(&self) -> String {
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

/// Places of the points that no other beats in both coordinates, from left to right.
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

/// Draws the error of each method over its time, one panel for each family, with the front of those that no other beats.
///
/// # Errors
/// When there is nothing to draw, or the file cannot be written.
pub fn draw_accuracy(path: &Path, families: &[FamilyCosts]) -> Result<(), FigureError> {
    let costs = || families.iter().flat_map(|family| &family.costs);
    let drawn: Vec<&Cost> = costs().filter(|cost| cost.error > 0.0 && cost.seconds > 0.0).collect();
    if drawn.is_empty() {
        return Err(FigureError::Data("no method has both an error and a time".into()));
    }
    let x = Axis::logarithmic("Time of one core per pattern [ms]", &times(drawn.iter().copied()));
    let largest = drawn.iter().map(|cost| cost.error).fold(0.0, f64::max);
    // Labels need room above the highest point.
    let errors: Vec<f64> = drawn.iter().map(|cost| cost.error).chain([2.0 * largest]).collect();
    let y = Axis::logarithmic("RMS error of a component [mm]", &errors);
    let shown: Vec<Entry<'_>> = GROUPS
        .iter()
        .filter(|group| drawn.iter().any(|cost| cost.group().1 == group.1))
        .map(|group| (group.1, group.2))
        .collect();
    let columns = COLUMNS.min(families.len());
    let rows = families.len().div_ceil(columns);
    let size = ((640 * columns as u32).max(1150), 96 + 600 * rows as u32);
    draw(path, size, |sheet| {
        let (head, body) = sheet.split_vertically(px(96));
        heading(&head, &shown)?;
        for (area, family) in body.split_evenly((rows, columns)).iter().zip(families) {
            one_family(area, family, &x, &y)?;
        }
        Ok(())
    })
}

fn times<'c>(costs: impl Iterator<Item = &'c Cost>) -> Vec<f64> {
    costs.map(|cost| 1e3 * cost.seconds).collect()
}

fn heading(head: &Area<'_>, shown: &[Entry<'_>]) -> Result<(), FigureError> {
    let middle = (head.dim_in_pixel().0 / 2) as i32;
    legend(head, shown, middle, px(20) as i32)?;
    let note = "ringed and labelled: no other method is both faster and more accurate; 2² Q1: 2 × 2 bilinear elements per cell, Q2: biquadratic";
    let style = text(19, palette::INK).pos(Pos::new(HPos::Center, VPos::Top));
    head.draw(&Text::new(note, (middle, px(58) as i32), style))?;
    Ok(())
}

fn one_family(area: &Area<'_>, family: &FamilyCosts, x: &Axis, y: &Axis) -> Result<(), FigureError> {
    let mut panel = panel(area, &family.family, &[], x, y)?;
    let costs: Vec<&Cost> = family
        .costs
        .iter()
        .filter(|c| c.error > 0.0 && c.seconds > 0.0)
        .collect();
    let points: Vec<(f64, f64)> = costs.iter().map(|c| (1e3 * c.seconds, c.error)).collect();
    let front = pareto_front(&points);
    let line: Vec<(f64, f64)> = front.iter().map(|&i| points[i]).collect();
    panel.draw_series(LineSeries::new(line, palette::GREY.stroke_width(px(2))))?;
    let dots = costs.iter().zip(&points);
    panel.draw_series(dots.map(|(cost, at)| Circle::new(*at, px(6), cost.group().2.filled())))?;
    panel.draw_series(
        front
            .iter()
            .map(|&i| Circle::new(points[i], px(8), palette::INK.stroke_width(px(2)))),
    )?;
    label(&mut panel, &costs, &points, &front)
}

/// Writes the labels of the front where they cover neither points nor each other.
fn label(panel: &mut Panel<'_>, costs: &[&Cost], points: &[(f64, f64)], front: &[usize]) -> Result<(), FigureError> {
    let style = text(18, palette::INK);
    let (wide, high) = panel.plotting_area().get_pixel_range();
    let mut labels = Labels::new([wide, high]);
    points
        .iter()
        .for_each(|at| labels.avoid_point(panel.backend_coord(at), px(9) as i32));
    let line: Vec<(i32, i32)> = front.iter().map(|&i| panel.backend_coord(&points[i])).collect();
    labels.avoid_line(&line);
    for &i in front {
        let words = costs[i].label();
        let size = panel.plotting_area().estimate_text_size(&words, &style)?;
        let Spot { x, y } = labels.place(
            panel.backend_coord(&points[i]),
            (size.0 as i32, size.1 as i32),
            px(14) as i32,
        );
        let mark = EmptyElement::at(points[i]) + Text::new(words, (x, y), style.clone());
        panel.draw_series(std::iter::once(mark))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let points = [(3.0, 1.0), (1.0, 5.0), (2.0, 5.0), (2.0, 2.0), (4.0, 1.0), (1.0, 6.0)];
        assert_eq!(pareto_front(&points), [1, 3, 0]);
        assert!(pareto_front(&[]).is_empty());
    }

    #[test]
    fn labels_say_what_the_legend_does_not() {
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
