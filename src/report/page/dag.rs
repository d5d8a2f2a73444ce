//! The pipeline drawn: each stage with its kind, its digest, what the last run did with it and what it cost.

use super::layout::{BOX, Layout, layout};
use super::svg::number;
use super::words::{bytes, cut, seconds};
use crate::report::course::{Course, StageFacts};
use crate::report::html::{Page, escaped};

/// Widths in units of the page: of a box, and of the room between two layers.
const WIDTH: f64 = 184.0;
const BETWEEN: f64 = 42.0;

/// Letters that fit in a box.
const NAME: usize = 21;
const LINE: usize = 30;

/// How small the drawing may become before it scrolls.
const SMALLEST: f64 = 0.72;

/// What became of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Built,
    Partly,
    Reused,
    Missing,
}

impl Fate {
    fn of(stage: &StageFacts) -> Self {
        match &stage.origin {
            None => Self::Missing,
            Some(origin) => match origin.built {
                None | Some(0) => Self::Reused,
                Some(n) if n < origin.chunks => Self::Partly,
                Some(_) => Self::Built,
            },
        }
    }

    fn colour(self) -> &'static str {
        match self {
            Self::Built => "blue",
            Self::Partly => "orange",
            Self::Reused => "green",
            Self::Missing => "grey",
        }
    }
}

/// What the last run did with a stage.
pub fn fate(stage: &StageFacts) -> String {
    match (&stage.origin, Fate::of(stage)) {
        (Some(origin), Fate::Partly) => {
            format!("built {} of {} chunks", origin.built.unwrap_or(0), origin.chunks)
        }
        (_, Fate::Built) => "built".to_owned(),
        (_, Fate::Missing) => "not built".to_owned(),
        (_, Fate::Reused | Fate::Partly) => "reused".to_owned(),
    }
}

/// What a stage took when it was built.
pub fn cost(stage: &StageFacts) -> String {
    let origin = stage.origin.as_ref();
    origin.map_or_else(String::new, |origin| seconds(origin.elapsed.unwrap_or(origin.work)))
}

/// Adds the drawing and what its colours mean.
pub fn section(page: &mut Page, course: &Course) {
    page.section("Pipeline");
    let fates: Vec<Fate> = course.stages.iter().map(Fate::of).collect();
    let entry = |fate: Fate, words: &str| {
        let n = fates.iter().filter(|f| **f == fate).count();
        let text = format!("<li class=\"{}\"><i></i>{n} {words}</li>", fate.colour());
        if n > 0 { text } else { String::new() }
    };
    let run = course.last_run.as_ref().map_or_else(
        || "No run of this pipeline is remembered in the store.".to_owned(),
        |ended| {
            format!(
                "The last run that changed anything ended {}.",
                super::words::time(ended)
            )
        },
    );
    page.lines(&[format!(
        "{run} Each box names a stage, its kind and digest, what that run did with it, and what it took when it was built."
    )]);
    page.markup(&format!(
        "<ul class=\"legend\">{}{}{}{}</ul>\n",
        entry(Fate::Built, "built"),
        entry(Fate::Partly, "built in part"),
        entry(Fate::Reused, "reused"),
        entry(Fate::Missing, "not built")
    ));
    page.scrolled("The stages of the pipeline and what they need", &draw(course));
}

fn draw(course: &Course) -> String {
    let needs: Vec<Vec<usize>> = course.stages.iter().map(|stage| stage.needs.clone()).collect();
    let placed = layout(&needs);
    let width = placed.layers as f64 * (WIDTH + BETWEEN) - BETWEEN + 4.0;
    let height = placed.height + 4.0;
    let (names, smallest) = (names(course), SMALLEST * width);
    let mut out = format!(
        "<svg class=\"dag\" viewBox=\"-2 -2 {width} {0}\" width=\"{width}\" height=\"{0}\" style=\"width:100%;min-width:{1}px;max-width:{width}px\" \
         role=\"img\" aria-label=\"{names}\"><title>{names}</title>\n",
        number(height, 0),
        number(smallest, 0)
    );
    out += &lines(&placed);
    for (stage, place) in course.stages.iter().zip(&placed.stages) {
        out += &boxed(stage, *place);
    }
    out + "</svg>"
}

fn names(course: &Course) -> String {
    let names: Vec<&str> = course.stages.iter().map(|stage| stage.name.as_str()).collect();
    escaped(&format!("Pipeline of {} stages: {}", names.len(), names.join(", ")))
}

fn left(layer: usize) -> f64 {
    layer as f64 * (WIDTH + BETWEEN)
}

fn lines(placed: &Layout) -> String {
    let mut path = String::new();
    for line in &placed.lines {
        for (k, pair) in line.windows(2).enumerate() {
            let ((from, y), (to, end)) = (pair[0], pair[1]);
            let (x, right, half) = (left(from) + WIDTH, left(to), 0.5 * BETWEEN);
            let [y, end] = [y, end].map(|v| number(v, 1));
            if k == 0 {
                path += &format!("M{x} {y}");
            } else {
                path += &format!("H{x}");
            }
            path += &format!("C{} {y} {} {end} {right} {end}", x + half, right - half);
        }
    }
    format!("<path d=\"{path}\"/>\n")
}

fn boxed(stage: &StageFacts, (layer, middle): (usize, f64)) -> String {
    let fate_of = Fate::of(stage);
    let [name, kind] = [cut(&stage.name, NAME), stage.kind.clone()].map(|text| escaped(&text));
    let digest = stage
        .digest
        .map_or_else(|| "no artifact".to_owned(), |digest| digest.to_string()[..8].to_owned());
    let size = match stage.bytes {
        0 => String::new(),
        size => format!(" · {}", bytes(size)),
    };
    let cost = match cost(stage) {
        cost if cost.is_empty() => String::new(),
        cost => format!(" · {cost}"),
    };
    let fate = escaped(&cut(&format!("{}{cost}{size}", short(stage)), LINE));
    let says = escaped(&format!(
        "{}: {}, {}{}",
        stage.name,
        stage.kind,
        self::fate(stage),
        stage.why.as_ref().map_or_else(String::new, |why| format!(": {why}"))
    ));
    let digest_at = 10.0 + 6.4 * (kind.chars().count() + 2) as f64;
    format!(
        "<g transform=\"translate({} {})\"><title>{says}</title><rect width=\"{WIDTH}\" height=\"{BOX}\" rx=\"6\"/>\
         <rect class=\"bar {}\" x=\"0\" y=\"0\" width=\"5\" height=\"{BOX}\" rx=\"2.5\"/>\
         <text class=\"name\" x=\"13\" y=\"21\">{name}</text><text x=\"13\" y=\"39\">{kind}</text>\
         <text class=\"mono\" x=\"{digest_at}\" y=\"39\">{digest}</text><text x=\"13\" y=\"56\">{fate}</text></g>\n",
        left(layer),
        number(middle - 0.5 * BOX, 1),
        fate_of.colour(),
    )
}

fn short(stage: &StageFacts) -> String {
    match (&stage.origin, Fate::of(stage)) {
        (Some(origin), Fate::Partly) => format!("{}/{} built", origin.built.unwrap_or(0), origin.chunks),
        _ => fate(stage),
    }
}
