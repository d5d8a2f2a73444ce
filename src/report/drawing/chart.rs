//! A chart: two axes, and series as lines, dots or bars.
//!
//! It is drawn once, as SVG. The page shows it with title and legend as text; a figure file places the same SVG on a
//! sheet and rasterises it.

use maud::{Markup, html};

use super::axis::Axis;
use super::labels::{LabelOffset, LabelPlacer, distance};
use super::path::{number, path};

/// Default size of a chart, so small that its text is readable on a telephone. Units are pixels of the page, where text
/// is 12 high.
const SIZE: [f64; 2] = [380.0, 268.0];

/// Size of a chart that is the only one on its sheet.
pub const LARGE: [f64; 2] = [708.0, 410.0];

/// The largest number of curves with names in the legend: more names would fill the chart.
pub const MAX_NAMED: usize = 7;

/// Space around the frame for ticks and labels. The label of the y axis is above the frame, so that it can be as long
/// as the chart is wide.
pub const LEFT: f64 = 56.0;
pub const RIGHT: f64 = 14.0;
pub const TOP: f64 = 28.0;
pub const BELOW: f64 = 44.0;

/// Upper bounds of the width of a letter and the height of a line, for text of 12 units.
pub const LETTER: f64 = 6.2;
const LINE: i32 = 13;
/// Between a point and its label.
const GAP: i32 = 10;
/// The outer edge of the ring around a labelled point.
const RING: f64 = 7.0;

/// The unit of drawings within the frame is a thousandth of the frame.
pub const THOUSAND: f64 = 1000.0;

/// A colour of drawings; the style sheet defines its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// Blue. The colours are those of Okabe and Ito.
    Blue,
    /// Light blue.
    Sky,
    /// Orange.
    Orange,
    /// Red that everybody can tell from green.
    Vermillion,
    /// Bluish green.
    Green,
    /// Reddish purple.
    Purple,
    /// Grey.
    Grey,
}

impl Colour {
    /// Colours of several series, in this order and again from the beginning.
    pub const ALL: [Self; 7] = [
        Self::Blue,
        Self::Orange,
        Self::Green,
        Self::Vermillion,
        Self::Purple,
        Self::Sky,
        Self::Grey,
    ];

    /// Its class in the style sheet.
    pub fn class(self) -> &'static str {
        match self {
            Self::Blue => "blue",
            Self::Sky => "sky",
            Self::Orange => "orange",
            Self::Vermillion => "vermillion",
            Self::Green => "green",
            Self::Purple => "purple",
            Self::Grey => "grey",
        }
    }
}

/// A chart.
#[derive(Clone)]
pub struct Chart {
    /// The title.
    pub title: String,
    /// A note below the title.
    pub note: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The series, the last on top.
    pub series: Vec<Series>,
    /// Width and height with ticks and labels.
    pub size: [f64; 2],
    /// Drawn below the series, in thousandths of the frame from its upper left corner.
    pub inside: Option<Markup>,
}

/// A series of points.
#[derive(Clone)]
pub struct Series {
    /// Its name in the legend, if it has one.
    pub name: Option<String>,
    /// Its colour.
    pub colour: Colour,
    /// How it is drawn.
    pub mark: Mark,
    /// Its points in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// A text for each point, or none: a tooltip, or a label, depending on the mark.
    pub texts: Vec<String>,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A line.
    Line,
    /// A wide line, which stands out among others.
    Wide,
    /// A thin line.
    Thin,
    /// A dashed line.
    Dashed,
    /// A line with a dot at each point, where they are few enough to be seen one by one.
    LineAndDots,
    /// A dot at each point.
    Dots,
    /// Small dots, for many points.
    Cloud,
    /// Rings around the points, with their texts as labels.
    Labelled,
    /// Bars: points are pairs of corners, lower left and upper right. Texts stand at their ends.
    Bars,
}

/// What stands before a name in a legend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LegendKey {
    /// A piece of a line.
    Line,
    /// A piece of a dashed line.
    Dashed,
    /// A dot.
    Dot,
    /// A square.
    Square,
}

impl LegendKey {
    /// Its class in the style sheet; that of a square has none.
    pub fn class(self) -> Option<&'static str> {
        match self {
            Self::Line => Some("stroke"),
            Self::Dashed => Some("dashes"),
            Self::Dot => Some("dot"),
            Self::Square => None,
        }
    }
}

impl Mark {
    fn legend_key(self) -> LegendKey {
        match self {
            Self::Line | Self::Wide | Self::Thin => LegendKey::Line,
            Self::Dashed => LegendKey::Dashed,
            Self::Dots | Self::Cloud => LegendKey::Dot,
            Self::LineAndDots | Self::Labelled | Self::Bars => LegendKey::Square,
        }
    }
}

/// Lines with more points have no dots.
const MAX_DOTS: usize = 40;

impl Series {
    /// Creates a series without texts.
    pub fn new(name: &str, colour: Colour, mark: Mark, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: (!name.is_empty()).then(|| name.to_owned()),
            colour,
            mark,
            points,
            texts: Vec::new(),
        }
    }

    /// Creates the bars of a histogram, without empty bins.
    pub fn bars(name: &str, colour: Colour, edges: &[f64], counts: &[u64]) -> Self {
        let bins = counts.iter().zip(edges.windows(2)).filter(|(count, _)| **count > 0);
        let corners = bins.flat_map(|(count, edge)| [(edge[0], 0.0), (edge[1], *count as f64)]);
        Self::new(name, colour, Mark::Bars, corners.collect())
    }

    /// Creates the outline of a histogram.
    pub fn outline(name: &str, colour: Colour, edges: &[f64], counts: &[u64]) -> Self {
        let tops = counts.iter().zip(edges.windows(2));
        let tops = tops.flat_map(|(count, edge)| [(edge[0], *count as f64), (edge[1], *count as f64)]);
        Self::new(name, colour, Mark::Line, tops.collect())
    }

    /// Adds a text for each point.
    pub fn with_texts(mut self, texts: Vec<String>) -> Self {
        self.texts = texts;
        self
    }

    /// Pairs curves with different colours.
    pub fn coloured<T>(curves: impl IntoIterator<Item = T>) -> impl Iterator<Item = (T, Colour)> {
        curves.into_iter().zip(Colour::ALL.into_iter().cycle())
    }
}

impl Chart {
    /// Creates a chart of the default size.
    pub fn new(title: impl Into<String>, [x, y]: [Axis; 2], series: Vec<Series>) -> Self {
        Self {
            title: title.into(),
            note: String::new(),
            x,
            y,
            series,
            size: SIZE,
            inside: None,
        }
    }

    /// Adds a note below the title.
    pub fn with_note(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }

    /// Sets the size.
    pub fn with_size(mut self, size: [f64; 2]) -> Self {
        self.size = size;
        self
    }

    /// Sets the size by the width and height of the frame.
    pub fn with_frame(self, [width, height]: [f64; 2]) -> Self {
        self.with_size([LEFT + width + RIGHT, TOP + height + BELOW])
    }

    /// Makes the frame a square.
    pub fn square(self, side: f64) -> Self {
        self.with_frame([side; 2])
    }

    /// Returns the entries of the legend: key, colour and name.
    pub fn legend(&self) -> impl Iterator<Item = (LegendKey, Colour, &str)> {
        let named = self.series.iter().filter(|series| series.name.is_some());
        named.map(|series| {
            let name = series.name.as_deref().unwrap_or_default();
            (series.mark.legend_key(), series.colour, name)
        })
    }

    /// Draws the chart with its title and legend, for a page.
    pub fn figure(&self) -> Markup {
        let description = format!("{}: {} over {}", self.title, self.y.label(), self.x.label());
        let [width, height] = self.size.map(|v| number(v, 1));
        html! {
            figure {
                figcaption { b { (self.title) } @if !self.note.is_empty() { " " (self.note) } }
                @if self.legend().next().is_some() {
                    ul.legend {
                        @for (key, colour, name) in self.legend() {
                            li class=(colour.class()) { i class=[key.class()] {} (name) }
                        }
                    }
                }
                svg.chart viewBox={ "0 0 " (width) " " (height) } width=(width) height=(height)
                    role="img" aria-label=(description) {
                    title { (description) }
                    (self.plot())
                }
            }
        }
    }

    /// Draws frame and series, without title and legend.
    pub fn plot(&self) -> Markup {
        let [left, top, right, bottom] = self.frame();
        let (across, down) = ((right - left) / THOUSAND, (bottom - top) / THOUSAND);
        html! {
            (self.axes())
            @if let Some(inside) = &self.inside {
                g transform={ "translate(" (left) " " (top) ") scale(" (across) " " (down) ")" } { (inside) }
            }
            @for series in &self.series { (self.drawn(series)) }
        }
    }

    /// Returns left, top, right and bottom of the frame.
    fn frame(&self) -> [f64; 4] {
        [LEFT, TOP, self.size[0] - RIGHT, self.size[1] - BELOW]
    }

    fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let [left, top, right, bottom] = self.frame();
        (
            left + (right - left) * self.x.fraction(x),
            bottom - (bottom - top) * self.y.fraction(y).clamp(-1.0, 2.0),
        )
    }

    fn shows(&self, (x, y): (f64, f64)) -> bool {
        x.is_finite() && y.is_finite() && self.x.shows(x) && self.y.shows(y)
    }

    fn axes(&self) -> Markup {
        let [left, top, right, bottom] = self.frame();
        let across: Vec<(String, String)> = self
            .x
            .ticks()
            .map(|(tick, text)| (number(left + (right - left) * self.x.fraction(tick), 1), text))
            .collect();
        let upwards: Vec<(f64, String)> = self
            .y
            .ticks()
            .map(|(tick, text)| (bottom - (bottom - top) * self.y.fraction(tick), text))
            .collect();
        let grid = across.iter().map(|(x, _)| format!("M{x} {top}V{bottom}"));
        let grid = grid.chain(
            upwards
                .iter()
                .map(|(y, _)| format!("M{left} {}H{right}", number(*y, 1))),
        );
        let x = number(0.5 * (left + right), 1);
        html! {
            path class="grid" d=(grid.collect::<String>()) {}
            @for (x, text) in &across {
                text x=(x) y=(number(bottom + 16.0, 1)) text-anchor="middle" { (text) }
            }
            @for (y, text) in &upwards {
                text x=(left - 7.0) y=(number(y + 4.0, 1)) text-anchor="end" { (text) }
            }
            path class="axis" d={ "M" (left) " " (top) "V" (bottom) "H" (right) } {}
            text class="ink" x=(x) y=(number(self.size[1] - 8.0, 1)) text-anchor="middle" { (self.x.label()) }
            text class="ink" x="2" y=(number(top - 14.0, 1)) { (self.y.label()) }
        }
    }

    fn drawn(&self, series: &Series) -> Markup {
        let colour = series.colour.class();
        let positions = || series.points.iter().filter(|p| self.shows(**p)).map(|p| self.at(*p));
        let line = |tenths: u8| {
            // Coordinates are integers in tenths of a unit.
            let fine: Vec<(f64, f64)> = positions().map(|(x, y)| (10.0 * x, 10.0 * y)).collect();
            let width = format!("stroke-width:{tenths}");
            html! {
                path class={ "line " (colour) } transform="scale(.1)" style=(width) d=(path(&fine, false)) {}
            }
        };
        match series.mark {
            Mark::LineAndDots if series.points.len() <= MAX_DOTS => html! { (line(20)) (self.dots(series, 3.0)) },
            Mark::Line | Mark::LineAndDots => line(20),
            Mark::Wide => line(36),
            Mark::Thin => line(13),
            Mark::Dashed => {
                let points: Vec<(f64, f64)> = positions().collect();
                html! { path class={ "dashed " (colour) } d=(path(&points, false)) {} }
            }
            Mark::Dots => self.dots(series, 3.5),
            Mark::Cloud => {
                let dots = positions().map(|(x, y)| format!("M{} {}h0", number(x, 1), number(y, 1)));
                html! { path class={ "dots " (colour) } d=(dots.collect::<String>()) {} }
            }
            Mark::Labelled => self.labels(series),
            Mark::Bars => self.bars(series),
        }
    }

    fn bars(&self, series: &Series) -> Markup {
        let corners: Vec<(f64, f64)> = series.points.iter().map(|p| self.at(*p)).collect();
        let bar = |pair: &[(f64, f64)]| {
            let ((left, bottom), (right, top)) = (pair[0], pair[1]);
            let [x, w, h] = [left, right - left, top - bottom].map(|v| number(v, 1));
            format!("M{x} {}h{w}v{h}H{x}z", number(bottom, 1))
        };
        let bars: String = corners.chunks_exact(2).map(bar).collect();
        let ends = corners.chunks_exact(2).zip(&series.texts).map(|(pair, text)| {
            let ((left, bottom), (right, top)) = (pair[0], pair[1]);
            let below = if top > bottom { top + 13.0 } else { top - 4.0 };
            (number(0.5 * (left + right), 1), number(below, 1), text)
        });
        html! {
            path class={ "bars " (series.colour.class()) } d=(bars) {}
            @for (x, y, text) in ends {
                text class="ink" x=(x) y=(y) text-anchor="middle" { (text) }
            }
        }
    }

    fn dots(&self, series: &Series, radius: f64) -> Markup {
        html! {
            @for (k, point) in series.points.iter().enumerate().filter(|(_, point)| self.shows(**point)) {
                @let (x, y) = self.at(*point);
                circle class=(series.colour.class()) cx=(number(x, 1)) cy=(number(y, 1)) r=(radius) {
                    @if let Some(text) = series.texts.get(k) { title { (text) } }
                }
            }
        }
    }

    /// Draws labels beside the points, so that they cover neither points nor lines nor the labels of any series.
    fn labels(&self, series: &Series) -> Markup {
        let pixel = |(x, y): (f64, f64)| (x.round() as i32, y.round() as i32);
        let pixels =
            |series: &Series| -> Vec<(i32, i32)> { series.points.iter().map(|p| pixel(self.at(*p))).collect() };
        let [left, top, right, bottom] = self.frame().map(|v| v as i32);
        let mut labels = LabelPlacer::new([left..right + (RIGHT - 2.0) as i32, top..bottom]);
        for other in self.series.iter().filter(|other| other.mark != Mark::Dashed) {
            let points = pixels(other);
            points.iter().for_each(|point| labels.avoid_point(*point, 4));
            if !matches!(other.mark, Mark::Dots | Mark::Cloud | Mark::Bars) {
                labels.avoid_line(&points);
            }
        }
        let width = |text: &String| (LETTER * text.chars().count() as f64) as i32;
        let requested = |labelled: &Series| -> Vec<_> {
            let requests = pixels(labelled).into_iter().zip(&labelled.texts);
            requests.map(|(at, text)| (at, (width(text), LINE))).collect()
        };
        // All series are placed together; those before this one come first.
        let labelled = || self.series.iter().filter(|other| other.mark == Mark::Labelled);
        let before = labelled().take_while(|other| !std::ptr::eq(*other, series));
        let before = before.flat_map(requested).count();
        let all = labels.place(&labelled().flat_map(requested).collect::<Vec<_>>(), GAP);
        let offsets: Vec<LabelOffset> = all.into_iter().skip(before).collect();
        let (line, requests) = (pixels(series), requested(series));
        html! {
            @for ((((x, y), size), text), offset) in requests.iter().zip(&series.texts).zip(&offsets) {
                circle class="ring" cx=(x) cy=(y) r="6" {}
                // The offset is of the upper left corner, text is placed by its base line.
                text class="ink" x=(x + offset.x) y=(y + offset.y + LINE - 3) { (text) }
                @let others = line.iter().filter(|other| **other != (*x, *y));
                @let label = [x + offset.x, y + offset.y, size.0, size.1];
                @let nearest = others.map(|other| distance(*other, label)).fold(f64::INFINITY, f64::min);
                @if let Some((from, to)) = leader(*offset, *size, nearest) {
                    @let ends = [from.0, from.1, f64::from(*x) + to.0, f64::from(*y) + to.1].map(|v| number(v, 1));
                    path class="leader" d={ "M" (x) " " (y) "m" (ends[0]) " " (ends[1]) "L" (ends[2]) " " (ends[3]) } {}
                }
            }
        }
    }
}

/// Returns both ends of a line from a point to its label, relative to the point, if the label is far from it, or almost
/// as near to another point, at a distance of `nearest`.
fn leader(offset: LabelOffset, (width, height): (i32, i32), nearest: f64) -> Option<((f64, f64), (f64, f64))> {
    let (x, y) = (
        0.clamp(offset.x, offset.x + width),
        0.clamp(offset.y, offset.y + height),
    );
    let (x, y) = (f64::from(x), f64::from(y));
    let distance = x.hypot(y);
    let edge = RING / distance;
    let is_unclear = distance > RING && nearest < 2.0 * distance;
    (is_unclear || distance > 1.5 * f64::from(GAP)).then_some(((edge * x, edge * y), (x, y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_has_a_legend_its_points_and_their_texts() {
        let points = vec![(0.0, 0.0), (5.0, 2.0)];
        let axes = [Axis::linear("x [mm]", 0.0, 10.0), Axis::linear("y", 0.0, 2.0)];
        let series = vec![
            Series::new("line", Colour::Blue, Mark::Line, points.clone()),
            Series::new("", Colour::Green, Mark::Dots, points).with_texts(vec!["first".into(), "second".into()]),
        ];
        let text = Chart::new("a <b>", axes, series).figure().into_string();
        assert!(
            text.contains("<li class=\"blue\"><i class=\"stroke\"></i>line</li>"),
            "{text}"
        );
        assert!(!text.contains("<li class=\"green\">"));
        // The middle of the frame from left to right, and its upper edge.
        assert!(
            text.contains("<circle class=\"green\" cx=\"211\" cy=\"28\" r=\"3.5\"><title>second</title>"),
            "{text}"
        );
        assert!(text.contains("a &lt;b&gt;") && text.contains("x [mm]"));
    }

    #[test]
    fn a_label_far_from_its_point_has_a_line_to_it() {
        assert_eq!(leader(LabelOffset { x: 10, y: -6 }, (60, LINE), f64::INFINITY), None);
        // So has a label with another point close by.
        let beside = leader(LabelOffset { x: 10, y: -6 }, (60, LINE), 15.0);
        assert_eq!(beside, Some(((7.0, 0.0), (10.0, 0.0))));
        assert_eq!(
            leader(LabelOffset { x: -30, y: -20 - LINE }, (60, LINE), f64::INFINITY),
            Some(((0.0, -7.0), (0.0, -20.0)))
        );
    }

    #[test]
    fn values_outside_of_an_axis_are_not_drawn() {
        let axes = [Axis::linear("x", 0.0, 1.0), Axis::logarithmic("y", &[0.1, 1.0])];
        let points = vec![(0.5, 0.0), (0.5, f64::NAN), (0.5, 1.0)];
        let chart = Chart::new("t", axes, vec![Series::new("", Colour::Blue, Mark::Dots, points)]);
        assert_eq!(chart.figure().into_string().matches("<circle").count(), 1);
    }
}
