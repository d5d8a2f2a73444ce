//! A chart as SVG: axes with round ticks, and series as lines, dots or bars. Its legend is text of the page, which wraps.

use super::svg::{number, path};
use crate::report::figures::{Axis, Labels, Spot};
use crate::report::html::escaped;

/// Size of a chart in units of the page, small enough that its text can be read on a telephone.
const WIDTH: f64 = 380.0;
const HEIGHT: f64 = 255.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 10.0;
const BELOW: f64 = 44.0;

/// Widths and heights that text of 12 units hardly exceeds.
const LETTER: f64 = 6.2;
const LINE: i32 = 13;

/// A chart.
pub struct Chart<'a> {
    /// What it shows.
    pub title: &'a str,
    /// A remark below the title.
    pub note: &'a str,
    /// The axis from left to right.
    pub x: Axis,
    /// The axis from below.
    pub y: Axis,
    /// What is drawn, the last on top.
    pub series: Vec<Series>,
}

/// One thing that is drawn.
#[derive(Clone)]
pub struct Series {
    /// Its name in the legend; none where there is nothing to say.
    pub name: Option<String>,
    /// A colour of the page: `blue`.
    pub colour: &'static str,
    /// How it is drawn.
    pub mark: Mark,
    /// Its points in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// Words that a pointer brings up, for each point or for none.
    pub words: Vec<String>,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A line.
    Line,
    /// A dashed line.
    Dashed,
    /// A line with a dot at each point.
    LineAndDots,
    /// A dot at each point.
    Dots,
    /// Small dots that are too many to be told apart.
    Cloud,
    /// Dots with rings, and with their words beside them.
    Labelled,
    /// Bars: points are pairs of corners, lower left and upper right.
    Bars,
}

impl Series {
    /// A series without words.
    pub fn new(name: &str, colour: &'static str, mark: Mark, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: (!name.is_empty()).then(|| name.to_owned()),
            colour,
            mark,
            points,
            words: Vec::new(),
        }
    }

    /// Adds words for each point.
    pub fn saying(mut self, words: Vec<String>) -> Self {
        self.words = words;
        self
    }
}

impl Chart<'_> {
    /// The chart with its title and legend.
    pub fn figure(&self) -> String {
        let entries = self.series.iter().filter_map(|series| {
            let name = escaped(series.name.as_ref()?);
            Some(format!("<li class=\"{}\"><i></i>{name}</li>", series.colour))
        });
        let entries: String = entries.collect();
        let legend = match entries.is_empty() {
            true => String::new(),
            false => format!("<ul class=\"legend\">{entries}</ul>\n"),
        };
        let note = match self.note {
            "" => String::new(),
            note => format!(" {}", escaped(note)),
        };
        let title = escaped(self.title);
        format!(
            "<figure><figcaption><b>{title}</b>{note}</figcaption>\n{legend}{}</figure>\n",
            self.svg()
        )
    }

    fn svg(&self) -> String {
        let says = escaped(&format!("{}: {} over {}", self.title, self.y.label(), self.x.label()));
        let mut out = format!(
            "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" role=\"img\" \
             aria-label=\"{says}\"><title>{says}</title>\n"
        );
        out += &self.frame();
        for series in &self.series {
            out += &self.drawn(series);
        }
        out + "</svg>\n"
    }

    fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let (wide, high) = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BELOW);
        (
            LEFT + wide * self.x.share(x),
            HEIGHT - BELOW - high * self.y.share(y).clamp(-1.0, 2.0),
        )
    }

    fn shows(&self, (x, y): (f64, f64)) -> bool {
        x.is_finite() && y.is_finite() && self.x.shows(x) && self.y.shows(y)
    }

    fn frame(&self) -> String {
        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BELOW);
        let (mut lines, mut texts) = (String::new(), String::new());
        for (tick, text) in self.x.ticks() {
            let x = number(LEFT + (right - LEFT) * self.x.share(tick), 1);
            lines += &format!("M{x} {TOP}V{bottom}");
            let text = escaped(&text);
            texts += &format!(
                "<text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{text}</text>",
                bottom + 16.0
            );
        }
        for (tick, text) in self.y.ticks() {
            let y = bottom - (bottom - TOP) * self.y.share(tick);
            lines += &format!("M{LEFT} {}H{right}", number(y, 1));
            let (x, y, text) = (LEFT - 7.0, number(y + 4.0, 1), escaped(&text));
            texts += &format!("<text x=\"{x}\" y=\"{y}\" text-anchor=\"end\">{text}</text>");
        }
        let (x, y) = ((LEFT + right) / 2.0, (TOP + bottom) / 2.0);
        format!(
            "<path class=\"grid\" d=\"{lines}\"/>{texts}\n<path class=\"axis\" d=\"M{LEFT} {TOP}V{bottom}H{right}\"/>\
             <text class=\"ink\" x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
             <text class=\"ink\" transform=\"translate(12 {y}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
            HEIGHT - 8.0,
            escaped(self.x.label()),
            escaped(self.y.label()),
        )
    }

    fn drawn(&self, series: &Series) -> String {
        let colour = series.colour;
        let places = || series.points.iter().filter(|p| self.shows(**p)).map(|p| self.at(*p));
        let line = |class: &str| {
            // A tenth of a unit is less than a pixel.
            let fine: Vec<(f64, f64)> = places().map(|(x, y)| (10.0 * x, 10.0 * y)).collect();
            format!(
                "<path class=\"{class} {colour}\" transform=\"scale(.1)\" style=\"stroke-width:20\" d=\"{}\"/>\n",
                path(&fine, false)
            )
        };
        match series.mark {
            Mark::Line => line("line"),
            Mark::Dashed => format!(
                "<path class=\"dashed {colour}\" d=\"{}\"/>\n",
                path(&places().collect::<Vec<_>>(), false)
            ),
            Mark::LineAndDots => line("line") + &self.dots(series, 3.0),
            Mark::Dots => self.dots(series, 3.5),
            Mark::Cloud => {
                let dots = places().map(|(x, y)| format!("M{} {}h0", number(x, 1), number(y, 1)));
                format!("<path class=\"dots {colour}\" d=\"{}\"/>\n", dots.collect::<String>())
            }
            Mark::Labelled => self.dots(series, 4.0) + &self.labels(series),
            Mark::Bars => {
                let corners: Vec<(f64, f64)> = series.points.iter().map(|p| self.at(*p)).collect();
                let bar = |pair: &[(f64, f64)]| {
                    let ((left, bottom), (right, top)) = (pair[0], pair[1]);
                    let [x, w, h] = [left, right - left, top - bottom].map(|v| number(v, 1));
                    format!("M{x} {}h{w}v{h}H{x}z", number(bottom, 1))
                };
                let bars: String = corners.chunks_exact(2).map(bar).collect();
                format!("<path class=\"bars {colour}\" d=\"{bars}\"/>\n")
            }
        }
    }

    fn dots(&self, series: &Series, radius: f64) -> String {
        let mut out = String::new();
        for (k, point) in series.points.iter().enumerate() {
            if !self.shows(*point) {
                continue;
            }
            let (x, y) = self.at(*point);
            let words = series
                .words
                .get(k)
                .map_or(String::new(), |words| format!("<title>{}</title>", escaped(words)));
            let (x, y) = (number(x, 1), number(y, 1));
            out += &format!(
                "<circle class=\"{}\" cx=\"{x}\" cy=\"{y}\" r=\"{radius}\">{words}</circle>",
                series.colour
            );
        }
        out + "\n"
    }

    /// Words beside the points, where they cover neither points nor each other.
    fn labels(&self, series: &Series) -> String {
        let pixel = |(x, y): (f64, f64)| (x.round() as i32, y.round() as i32);
        let (right, bottom) = ((WIDTH - 2.0) as i32, (HEIGHT - BELOW) as i32);
        let mut labels = Labels::new([LEFT as i32..right, TOP as i32..bottom]);
        let all = self.series.iter().flat_map(|series| &series.points);
        all.for_each(|point| labels.avoid_point(pixel(self.at(*point)), 4));
        let line: Vec<(i32, i32)> = series.points.iter().map(|p| pixel(self.at(*p))).collect();
        labels.avoid_line(&line);
        let mut out = String::new();
        for (at, words) in line.iter().zip(&series.words) {
            let width = (LETTER * words.chars().count() as f64) as i32;
            let Spot { x, y } = labels.place(*at, (width, LINE), 10);
            // The spot is an upper left corner, text stands on its base line.
            let (x, y, words) = (at.0 + x, at.1 + y + LINE - 3, escaped(words));
            out += &format!(
                "<circle class=\"ring\" cx=\"{}\" cy=\"{}\" r=\"6\"/><text class=\"ink\" x=\"{x}\" y=\"{y}\">{words}</text>",
                at.0, at.1
            );
        }
        out + "\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_has_a_legend_its_points_and_their_words() {
        let points = vec![(0.0, 0.0), (5.0, 2.0)];
        let chart = Chart {
            title: "a <b>",
            note: "",
            x: Axis::linear("x [mm]", 0.0, 10.0),
            y: Axis::linear("y", 0.0, 2.0),
            series: vec![
                Series::new("line", "blue", Mark::Line, points.clone()),
                Series::new("", "green", Mark::Dots, points).saying(vec!["first".into(), "second".into()]),
            ],
        };
        let text = chart.figure();
        assert!(text.contains("<li class=\"blue\"><i></i>line</li>") && !text.contains("<li class=\"green\">"));
        // The middle of the frame from left to right, and its upper edge.
        assert!(
            text.contains("<circle class=\"green\" cx=\"215\" cy=\"10\" r=\"3.5\"><title>second</title>"),
            "{text}"
        );
        assert!(text.contains("a &lt;b&gt;") && text.contains("x [mm]"));
    }

    #[test]
    fn what_an_axis_does_not_show_is_not_drawn() {
        let values = [0.1, 1.0];
        let chart = Chart {
            title: "t",
            note: "",
            x: Axis::linear("x", 0.0, 1.0),
            y: Axis::logarithmic("y", &values),
            series: vec![Series::new(
                "",
                "blue",
                Mark::Dots,
                vec![(0.5, 0.0), (0.5, f64::NAN), (0.5, 1.0)],
            )],
        };
        assert_eq!(chart.figure().matches("<circle").count(), 1);
    }
}
