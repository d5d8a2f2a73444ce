//! Axes with round ticks, and the frame that every panel shares.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{Area, FigureError, palette, px, text};

/// A panel whose coordinates are the numbers that an [`Axis`] places.
pub(super) type Panel<'a> = ChartContext<'a, BitMapBackend<'a>, Cartesian2d<Axis, Axis>>;

/// Where numbers stand along one side of a panel, and what is written there.
#[derive(Clone)]
pub(in crate::report) struct Axis {
    label: String,
    low: f64,
    high: f64,
    ticks: Vec<f64>,
    logarithmic: bool,
    writing: Writing,
}

#[derive(Clone)]
enum Writing {
    Decimals(usize),
    Shortest,
    Names(Vec<String>),
}

impl Axis {
    /// From `low` to `high`, with about seven round ticks.
    pub(in crate::report) fn linear(label: &str, low: f64, high: f64) -> Self {
        let high = if high > low { high } else { low + 1.0 };
        let step = round_step((high - low) / 6.0);
        let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
        Self {
            label: label.to_owned(),
            low,
            high,
            ticks: (first..=last).map(|k| k as f64 * step).collect(),
            logarithmic: false,
            writing: Writing::Decimals((-step.log10().floor()).max(0.0) as usize),
        }
    }

    /// For counts: ticks on whole numbers only, on each where there are few.
    pub(in crate::report) fn counting(label: &str, low: f64, high: f64) -> Self {
        let mut axis = Self::linear(label, low, high);
        if axis.high - axis.low <= 12.0 {
            axis.ticks = (axis.low.ceil() as i64..=axis.high.floor() as i64)
                .map(|k| k as f64)
                .collect();
        }
        axis.writing = Writing::Decimals(0);
        axis
    }

    /// From zero, or below if need be, to a little above the largest of some values.
    pub(in crate::report) fn above<'v>(label: &str, values: impl IntoIterator<Item = &'v f64>) -> Self {
        let (low, high) = values
            .into_iter()
            .fold((0.0, 0.0), |(l, h): (f64, f64), v| (l.min(*v), h.max(*v)));
        let margin = if high > low { 0.15 * (high - low) } else { 1.0 };
        Self::linear(label, if low < 0.0 { low - margin } else { 0.0 }, high + margin)
    }

    /// Around some values and zero, with as much room above as below.
    pub(in crate::report) fn around<'v>(label: &str, values: impl IntoIterator<Item = &'v f64>) -> Self {
        let largest = values.into_iter().fold(0.0, |a: f64, v| a.max(v.abs()));
        let end = if largest > 0.0 { 1.15 * largest } else { 1.0 };
        Self::linear(label, -end, end)
    }

    /// Logarithmic around some positive values; others do not count.
    pub(in crate::report) fn logarithmic<'v>(label: &str, values: impl IntoIterator<Item = &'v f64>) -> Self {
        let logs = values.into_iter().filter(|v| **v > 0.0).map(|v| v.log10());
        let (low, high) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (-1.0, 0.0) };
        let margin = (0.06 * (high - low)).max(0.05);
        let (low, high) = (low - margin, high + margin);
        let axis = Self {
            logarithmic: true,
            ..Self::linear(label, 10f64.powf(low), 10f64.powf(high))
        };
        if high - low < 1.0 {
            // Within a decade the round numbers of a linear axis are as good, and there are enough of them.
            return axis;
        }
        let within: &[f64] = if high - low < 2.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let ticks = (low.floor() as i32..=high.ceil() as i32)
            .flat_map(|decade| within.iter().map(move |m| m * 10f64.powi(decade)))
            .filter(|t| (low..=high).contains(&t.log10()))
            .collect();
        Self {
            ticks,
            writing: Writing::Shortest,
            ..axis
        }
    }

    /// One tick per name, at 0, 1, 2, …
    pub(super) fn names(names: Vec<String>) -> Self {
        Self {
            ticks: (0..names.len()).map(|k| k as f64).collect(),
            writing: Writing::Names(names.clone()),
            ..Self::linear("", -0.5, names.len() as f64 - 0.5)
        }
    }

    /// Whether a value stands anywhere: on a logarithmic axis only positive ones do.
    pub(in crate::report) fn shows(&self, value: f64) -> bool {
        !self.logarithmic || value > 0.0
    }

    /// What is measured along it.
    pub(in crate::report) fn label(&self) -> &str {
        &self.label
    }

    /// Where numbers are written, with what is written there.
    pub(in crate::report) fn ticks(&self) -> impl Iterator<Item = (f64, String)> {
        self.ticks.iter().map(|tick| (*tick, self.write(*tick)))
    }

    /// How far along the axis a value stands: 0 at its beginning, 1 at its end.
    pub(in crate::report) fn share(&self, value: f64) -> f64 {
        if self.logarithmic {
            (value / self.low).log10() / (self.high / self.low).log10()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    fn write(&self, tick: f64) -> String {
        match &self.writing {
            // −0.0 would be written with its sign.
            Writing::Decimals(decimals) => format!("{:.*}", decimals, tick + 0.0),
            Writing::Names(names) => names.get(tick.round() as usize).cloned().unwrap_or_default(),
            Writing::Shortest => {
                let digits = (-(tick.log10() + 1e-9).floor()).max(0.0) as usize;
                if digits <= 4 && tick < 99_999.0 {
                    format!("{tick:.digits$}")
                } else {
                    format!("{tick:.0e}")
                }
            }
        }
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        limit.0 + (self.share(*value) * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() {
            Vec::new()
        } else {
            self.ticks.clone()
        }
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        self.write(*value)
    }
}

/// The nearest of 1, 2, 5 times a power of ten that is not below `rough`.
fn round_step(rough: f64) -> f64 {
    let power = 10f64.powf(rough.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= rough * (1.0 - 1e-9));
    power * factor.unwrap_or(10.0)
}

/// What the legend says of one series.
pub(super) type Entry<'a> = (&'a str, RGBColor);

/// A panel with title, legend, frame, grid and labelled axes. The legend stands above the frame, where no data are.
pub(super) fn panel<'a>(
    area: &Area<'a>,
    title: &str,
    entries: &[Entry<'_>],
    x: &Axis,
    y: &Axis,
) -> Result<Panel<'a>, FigureError> {
    let (width, _) = area.dim_in_pixel();
    let (left, right) = (px(LEFT + 14), px(26));
    let middle = ((left + width.saturating_sub(right)) / 2) as i32;
    heading(area, title, middle)?;
    legend(area, entries, middle, px(48) as i32)?;
    let chart = ChartBuilder::on(area)
        .margin_top(px(if entries.is_empty() { 50 } else { 80 }))
        .margin_bottom(px(14))
        .margin_left(px(14))
        .margin_right(right)
        .x_label_area_size(px(BELOW))
        .y_label_area_size(px(LEFT))
        .build_cartesian_2d(x.clone(), y.clone())?;
    furnish(chart, x, y)
}

fn heading(area: &Area<'_>, title: &str, middle: i32) -> Result<(), FigureError> {
    let style = text(26, palette::INK).pos(Pos::new(HPos::Center, VPos::Top));
    area.draw(&Text::new(title.to_owned(), (middle, px(10) as i32), style))?;
    Ok(())
}

/// Swatches with names, in one line around `middle`, `top` subpixels below the edge.
pub(super) fn legend(area: &Area<'_>, entries: &[Entry<'_>], middle: i32, top: i32) -> Result<(), FigureError> {
    let style = text(20, palette::INK);
    let (swatch, gap, between) = (px(26) as i32, px(8) as i32, px(28) as i32);
    let mut widths = Vec::new();
    for (name, _) in entries {
        widths.push(area.estimate_text_size(name, &style)?.0 as i32);
    }
    let total: i32 = widths.iter().map(|w| swatch + gap + w).sum::<i32>() + between * (entries.len() as i32 - 1);
    let mut at = middle - total / 2;
    for ((name, colour), width) in entries.iter().zip(widths) {
        let half = px(4) as i32;
        let centre = top + px(6) as i32;
        let corners = [(at, centre - half), (at + swatch, centre + half)];
        area.draw(&Rectangle::new(corners, colour.filled()))?;
        area.draw(&Text::new((*name).to_owned(), (at + swatch + gap, top), style.clone()))?;
        at += swatch + gap + width + between;
    }
    Ok(())
}

/// A square panel, as large as fits, with a title and a line of explanation.
pub(super) fn square<'a>(area: &Area<'a>, title: &str, note: &str, axes: [&Axis; 2]) -> Result<Panel<'a>, FigureError> {
    let (width, height) = area.dim_in_pixel();
    let (left, above, below, right) = (px(LEFT + 14), px(76), px(BELOW + 14), px(20));
    let side = width
        .saturating_sub(left + right)
        .min(height.saturating_sub(above + below));
    let middle = (left + side / 2) as i32;
    heading(area, title, middle)?;
    let style = text(19, palette::INK).pos(Pos::new(HPos::Center, VPos::Top));
    area.draw(&Text::new(note.to_owned(), (middle, px(44) as i32), style))?;
    let chart = ChartBuilder::on(area)
        .margin_top(above)
        .margin_right(width - left - side)
        .margin_bottom(height - above - side - px(BELOW))
        .margin_left(left - px(LEFT))
        .x_label_area_size(px(BELOW))
        .y_label_area_size(px(LEFT))
        .build_cartesian_2d(axes[0].clone(), axes[1].clone())?;
    furnish(chart, axes[0], axes[1])
}

/// Room for the labels of an axis, in pixels of the finished figure.
const BELOW: u32 = 62;
const LEFT: u32 = 92;

fn furnish<'a>(mut chart: Panel<'a>, x: &Axis, y: &Axis) -> Result<Panel<'a>, FigureError> {
    chart
        .configure_mesh()
        .bold_line_style(palette::PALE.stroke_width(HAIR))
        .axis_style(palette::INK.stroke_width(px(1)))
        .label_style(text(20, palette::INK))
        .y_label_offset(px(3))
        .axis_desc_style(text(23, palette::INK))
        .x_desc(&x.label)
        .y_desc(&y.label)
        .set_all_tick_mark_size(px(5))
        .draw()?;
    Ok(chart)
}

/// Thinner than a pixel of the finished figure.
const HAIR: u32 = 2;

/// A line through points, marked where they are few enough to be seen one by one.
pub(super) fn line(panel: &mut Panel<'_>, colour: RGBColor, points: Vec<(f64, f64)>) -> Result<(), FigureError> {
    if points.len() <= 40 {
        let dots = points.iter().map(|p| Circle::new(*p, px(4), colour.filled()));
        panel.draw_series(dots)?;
    }
    panel.draw_series(LineSeries::new(points, colour.stroke_width(px(2))))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::linear("x", 0.0, 2.5);
        let texts: Vec<String> = axis.ticks.iter().map(|t| axis.write(*t)).collect();
        assert_eq!(texts, ["0.0", "0.5", "1.0", "1.5", "2.0", "2.5"]);
        let axis = Axis::counting("n", 0.0, 3.0);
        let texts: Vec<String> = axis.ticks.iter().map(|t| axis.write(*t)).collect();
        assert_eq!(texts, ["0", "1", "2", "3"]);
        assert_eq!(
            Axis::counting("n", 0.0, 60.0).ticks,
            [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
        );
    }

    #[test]
    fn logarithmic_axes_have_ticks_even_within_a_decade() {
        let texts = |values: &[f64]| {
            let axis = Axis::logarithmic("loss", values);
            axis.ticks.iter().map(|t| axis.write(*t)).collect::<Vec<_>>()
        };
        assert_eq!(
            texts(&[0.0153, 0.11, 0.0]),
            ["0.02", "0.04", "0.06", "0.08", "0.10", "0.12"]
        );
        assert_eq!(texts(&[0.0153, 0.3]), ["0.02", "0.05", "0.1", "0.2"]);
        assert_eq!(texts(&[1e-5, 1.0]), ["1e-5", "0.0001", "0.001", "0.01", "0.1", "1"]);
        assert!(texts(&[0.5]).len() > 2 && !texts(&[]).is_empty());
        assert!(!Axis::logarithmic("loss", &[1.0]).shows(0.0));
    }

    #[test]
    fn equal_ratios_are_equal_distances_on_a_logarithmic_axis() {
        let axis = Axis::logarithmic("loss", &[0.01, 1.0]);
        let place = |value: f64| axis.map(&value, (1000, 0));
        assert!((place(0.01) - place(0.1) - (place(0.1) - place(1.0))).abs() <= 1);
        assert!(place(0.01) > place(1.0), "pixels are counted from the top");
    }
}
