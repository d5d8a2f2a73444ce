//! A chart: axes with round ticks, and series as lines, dots or bars.
//!
//! It is drawn once, as SVG. The page takes that as it is, with title and legend as text that wraps; a figure places the
//! same SVG on a sheet and rasterises it.

use maud::{Markup, html};

use super::axis::Axis;
use super::labels::{Labels, Spot};
use super::path::{number, path};

/// Size of a chart unless another is asked for, small enough that its text can be read on a telephone. Units are pixels of
/// the page, where text is 12 high.
const SIZE: [f64; 2] = [380.0, 268.0];

/// Room around the frame for ticks and labels. What is measured upwards is written above the frame, where it can be as long as the chart is
/// wide and meets no tick.
pub const LEFT: f64 = 56.0;
pub const RIGHT: f64 = 14.0;
pub const TOP: f64 = 28.0;
pub const BELOW: f64 = 44.0;

/// Widths and heights that text of 12 units hardly exceeds.
pub const LETTER: f64 = 6.2;
const LINE: i32 = 13;
/// Between a point and its label.
const GAP: i32 = 10;
/// The outer edge of the ring around a labelled point.
const RING: f64 = 7.0;

/// What is drawn within the frame of a chart has thousandths of the frame as its unit.
pub const THOUSAND: f64 = 1000.0;

/// A colour of drawings. The style sheet gives it its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// Okabe and Ito's blue; the others are theirs too.
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
    /// Colours of several series of the same kind, in this order and from the beginning again.
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
    /// What it shows.
    pub title: String,
    /// A remark below the title.
    pub note: String,
    /// The axis from left to right.
    pub x: Axis,
    /// The axis from below.
    pub y: Axis,
    /// What is drawn, the last on top.
    pub series: Vec<Series>,
    /// Width and height with ticks and labels.
    pub size: [f64; 2],
    /// Drawn below the series, in thousandths of the frame from its upper left corner.
    pub inside: Option<Markup>,
}

/// One thing that is drawn.
#[derive(Clone)]
pub struct Series {
    /// Its name in the legend; none where there is nothing to say.
    pub name: Option<String>,
    /// Its colour.
    pub colour: Colour,
    /// How it is drawn.
    pub mark: Mark,
    /// Its points in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// Words for each point or for none: a pointer brings them up, or they stand beside it, as the mark has it.
    pub words: Vec<String>,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A line.
    Line,
    /// A dashed line.
    Dashed,
    /// A line with a dot at each point, where they are few enough to be seen one by one.
    LineAndDots,
    /// A dot at each point.
    Dots,
    /// Small dots that are too many to be told apart.
    Cloud,
    /// Rings around the points, and their words beside them.
    Labelled,
    /// Bars: points are pairs of corners, lower left and upper right. Words stand at their ends.
    Bars,
}

/// Points of a line that are seen one by one.
const FEW: usize = 40;

impl Series {
    /// A series without words.
    pub fn new(name: &str, colour: Colour, mark: Mark, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: (!name.is_empty()).then(|| name.to_owned()),
            colour,
            mark,
            points,
            words: Vec::new(),
        }
    }

    /// The bars of a histogram, without those of no height.
    pub fn bars(name: &str, colour: Colour, edges: &[f64], counts: &[u64]) -> Self {
        let bins = counts.iter().zip(edges.windows(2)).filter(|(count, _)| **count > 0);
        let corners = bins.flat_map(|(count, edge)| [(edge[0], 0.0), (edge[1], *count as f64)]);
        Self::new(name, colour, Mark::Bars, corners.collect())
    }

    /// The outline of a histogram.
    pub fn outline(name: &str, colour: Colour, edges: &[f64], counts: &[u64]) -> Self {
        let tops = counts.iter().zip(edges.windows(2));
        let tops = tops.flat_map(|(count, edge)| [(edge[0], *count as f64), (edge[1], *count as f64)]);
        Self::new(name, colour, Mark::Line, tops.collect())
    }

    /// Adds words for each point.
    pub fn with_words(mut self, words: Vec<String>) -> Self {
        self.words = words;
        self
    }
}

impl Chart {
    /// A chart of the usual size.
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

    /// Adds a remark below the title.
    pub fn with_note(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }

    /// Takes another size.
    pub fn with_size(mut self, size: [f64; 2]) -> Self {
        self.size = size;
        self
    }

    /// Takes the size that gives the frame this width and height.
    pub fn with_frame(self, [width, height]: [f64; 2]) -> Self {
        self.with_size([LEFT + width + RIGHT, TOP + height + BELOW])
    }

    /// Makes the frame a square.
    pub fn square(self, side: f64) -> Self {
        self.with_frame([side; 2])
    }

    /// What the legend names.
    pub fn legend(&self) -> impl Iterator<Item = (Colour, &str)> {
        let named = |series: &'_ Series| series.name.is_some();
        let entries = self.series.iter().filter(move |series| named(series));
        entries.map(|series| (series.colour, series.name.as_deref().unwrap_or_default()))
    }

    /// The chart with its title and legend, for a page.
    pub fn figure(&self) -> Markup {
        let description = format!("{}: {} over {}", self.title, self.y.label(), self.x.label());
        let [width, height] = self.size.map(|v| number(v, 1));
        html! {
            figure {
                figcaption { b { (self.title) } @if !self.note.is_empty() { " " (self.note) } }
                @if self.legend().next().is_some() {
                    ul.legend { @for (colour, name) in self.legend() { li class=(colour.class()) { i {} (name) } } }
                }
                svg.chart viewBox={ "0 0 " (width) " " (height) } width=(width) height=(height) role="img" aria-label=(description) {
                    title { (description) }
                    (self.plot())
                }
            }
        }
    }

    /// Frame and series, without title and legend.
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

    /// Left, top, right and bottom of the frame.
    fn frame(&self) -> [f64; 4] {
        [LEFT, TOP, self.size[0] - RIGHT, self.size[1] - BELOW]
    }

    fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let [left, top, right, bottom] = self.frame();
        (
            left + (right - left) * self.x.share(x),
            bottom - (bottom - top) * self.y.share(y).clamp(-1.0, 2.0),
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
            .map(|(tick, text)| (number(left + (right - left) * self.x.share(tick), 1), text))
            .collect();
        let upwards: Vec<(f64, String)> = self
            .y
            .ticks()
            .map(|(tick, text)| (bottom - (bottom - top) * self.y.share(tick), text))
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
        let places = || series.points.iter().filter(|p| self.shows(**p)).map(|p| self.at(*p));
        let line = || {
            // A tenth of a unit is less than a pixel.
            let fine: Vec<(f64, f64)> = places().map(|(x, y)| (10.0 * x, 10.0 * y)).collect();
            html! { path class={ "line " (colour) } transform="scale(.1)" style="stroke-width:20" d=(path(&fine, false)) {} }
        };
        match series.mark {
            Mark::LineAndDots if series.points.len() <= FEW => html! { (line()) (self.dots(series, 3.0)) },
            Mark::Line | Mark::LineAndDots => line(),
            Mark::Dashed => {
                let points: Vec<(f64, f64)> = places().collect();
                html! { path class={ "dashed " (colour) } d=(path(&points, false)) {} }
            }
            Mark::Dots => self.dots(series, 3.5),
            Mark::Cloud => {
                let dots = places().map(|(x, y)| format!("M{} {}h0", number(x, 1), number(y, 1)));
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
        let ends = corners.chunks_exact(2).zip(&series.words).map(|(pair, words)| {
            let ((left, bottom), (right, top)) = (pair[0], pair[1]);
            let below = if top > bottom { top + 13.0 } else { top - 4.0 };
            (number(0.5 * (left + right), 1), number(below, 1), words)
        });
        html! {
            path class={ "bars " (series.colour.class()) } d=(bars) {}
            @for (x, y, words) in ends {
                text class="ink" x=(x) y=(y) text-anchor="middle" { (words) }
            }
        }
    }

    fn dots(&self, series: &Series, radius: f64) -> Markup {
        html! {
            @for (k, point) in series.points.iter().enumerate().filter(|(_, point)| self.shows(**point)) {
                @let (x, y) = self.at(*point);
                circle class=(series.colour.class()) cx=(number(x, 1)) cy=(number(y, 1)) r=(radius) {
                    @if let Some(words) = series.words.get(k) { title { (words) } }
                }
            }
        }
    }

    /// Words beside the points, where they cover neither points nor each other.
    fn labels(&self, series: &Series) -> Markup {
        let pixel = |(x, y): (f64, f64)| (x.round() as i32, y.round() as i32);
        let [left, top, right, bottom] = self.frame().map(|v| v as i32);
        let mut labels = Labels::new([left..right + (RIGHT - 2.0) as i32, top..bottom]);
        let others = self.series.iter().filter(|other| other.mark != Mark::Dashed);
        let all = others.flat_map(|series| &series.points);
        all.for_each(|point| labels.avoid_point(pixel(self.at(*point)), 4));
        let line: Vec<(i32, i32)> = series.points.iter().map(|p| pixel(self.at(*p))).collect();
        labels.avoid_line(&line);
        let width = |words: &String| (LETTER * words.chars().count() as f64) as i32;
        let wanted: Vec<_> = line
            .iter()
            .zip(&series.words)
            .map(|(at, words)| (*at, (width(words), LINE)))
            .collect();
        let spots = labels.place(&wanted, GAP);
        html! {
            @for ((((x, y), size), words), spot) in wanted.iter().zip(&series.words).zip(&spots) {
                circle class="ring" cx=(x) cy=(y) r="6" {}
                // The spot is an upper left corner, text stands on its base line.
                text class="ink" x=(x + spot.x) y=(y + spot.y + LINE - 3) { (words) }
                @if let Some((dx, dy)) = leader(*spot, *size) {
                    path class="leader" d={ "M" (x) " " (y) "m" (number(dx.0, 1)) " " (number(dy.0, 1)) "L" (number(f64::from(*x) + dx.1, 1)) " " (number(f64::from(*y) + dy.1, 1)) } {}
                }
            }
        }
    }
}

/// From a point to its label where that stands too far to be taken for its own: x and y of both ends, seen from the point.
fn leader(spot: Spot, (width, height): (i32, i32)) -> Option<((f64, f64), (f64, f64))> {
    let (x, y) = (0.clamp(spot.x, spot.x + width), 0.clamp(spot.y, spot.y + height));
    let (x, y) = (f64::from(x), f64::from(y));
    let far = x.hypot(y);
    let edge = RING / far;
    (far > 1.5 * f64::from(GAP)).then_some(((edge * x, x), (edge * y, y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_has_a_legend_its_points_and_their_words() {
        let points = vec![(0.0, 0.0), (5.0, 2.0)];
        let axes = [Axis::linear("x [mm]", 0.0, 10.0), Axis::linear("y", 0.0, 2.0)];
        let series = vec![
            Series::new("line", Colour::Blue, Mark::Line, points.clone()),
            Series::new("", Colour::Green, Mark::Dots, points).with_words(vec!["first".into(), "second".into()]),
        ];
        let text = Chart::new("a <b>", axes, series).figure().into_string();
        assert!(text.contains("<li class=\"blue\"><i></i>line</li>") && !text.contains("<li class=\"green\">"));
        // The middle of the frame from left to right, and its upper edge.
        assert!(
            text.contains("<circle class=\"green\" cx=\"211\" cy=\"28\" r=\"3.5\"><title>second</title>"),
            "{text}"
        );
        assert!(text.contains("a &lt;b&gt;") && text.contains("x [mm]"));
    }

    #[test]
    fn a_label_that_stands_far_off_has_a_line_to_its_point() {
        assert_eq!(leader(Spot { x: 10, y: -6 }, (60, LINE)), None);
        assert_eq!(
            leader(Spot { x: -30, y: -20 - LINE }, (60, LINE)),
            Some(((0.0, 0.0), (-7.0, -20.0)))
        );
    }

    #[test]
    fn what_an_axis_does_not_show_is_not_drawn() {
        let axes = [Axis::linear("x", 0.0, 1.0), Axis::logarithmic("y", &[0.1, 1.0])];
        let points = vec![(0.5, 0.0), (0.5, f64::NAN), (0.5, 1.0)];
        let chart = Chart::new("t", axes, vec![Series::new("", Colour::Blue, Mark::Dots, points)]);
        assert_eq!(chart.figure().into_string().matches("<circle").count(), 1);
    }
}
