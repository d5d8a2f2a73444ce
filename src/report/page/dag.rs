//! The drawing of a pipeline: each stage with its kind, its digest, its state in the last run and its cost.

use maud::{Markup, html};

use super::layout::{BOX, Layout, layout};
use crate::drawing::{Colour, LETTER, number};
use crate::format::{bytes, cut, seconds};
use crate::history::{BuiltBy, PipelineHistory, StageRecord};
use crate::html::Page;
use deaflow_base::readable_time as time;

/// Widths in units of the page: of a box, and of the gap between two layers.
const WIDTH: f64 = 208.0;
const BETWEEN: f64 = 42.0;

/// From the left edge of a box to its text.
const INDENT: f64 = 13.0;

/// Letters that fit in a box.
const NAME: usize = 21;
const LINE: usize = 30;
const _: () = assert!(INDENT + LETTER * LINE as f64 <= WIDTH);

/// The scale at which the drawing starts to scroll.
const SMALLEST: f64 = 0.72;

/// The state of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BuildState {
    Built,
    Partly,
    Reused,
    Missing,
}

impl BuildState {
    fn of(stage: &StageRecord) -> Self {
        match &stage.origin {
            None => Self::Missing,
            Some(origin) => match origin.built {
                None | Some(0) => Self::Reused,
                Some(n) if n < origin.chunks => Self::Partly,
                Some(_) => Self::Built,
            },
        }
    }

    fn class(self) -> &'static str {
        let colour = match self {
            Self::Built => Colour::Blue,
            Self::Partly => Colour::Orange,
            Self::Reused => Colour::Green,
            Self::Missing => Colour::Grey,
        };
        colour.class()
    }
}

/// Describes what the last run did with a stage.
pub fn build_state(stage: &StageRecord) -> String {
    match (&stage.origin, BuildState::of(stage)) {
        (Some(origin), BuildState::Partly) => {
            format!("built {} of {} chunks", origin.built.unwrap_or(0), origin.chunks)
        }
        (_, BuildState::Built) => "built".to_owned(),
        (_, BuildState::Missing) => "not built".to_owned(),
        (_, BuildState::Reused | BuildState::Partly) => "reused".to_owned(),
    }
}

/// Returns the time that it took to build a stage.
pub fn cost(stage: &StageRecord) -> String {
    let origin = stage.origin.as_ref();
    origin.map_or_else(String::new, |origin| {
        seconds(origin.elapsed.or(origin.part).unwrap_or(origin.work))
    })
}

/// Names another run that built artifacts of the pipeline.
fn built_by(by: &BuiltBy) -> String {
    format!(
        "Artifacts of this pipeline were built by deaflow {} of {}, run {}, which ended {}.",
        by.command,
        by.pipeline,
        by.id,
        time(&by.ended)
    )
}

/// Adds the drawing and its legend.
pub fn section(page: &mut Page, history: &PipelineHistory) {
    page.section("Pipeline");
    let run = match &history.last_run {
        Some(run) if run.has_built => format!(
            "The last run that built a part of this pipeline with these parameters ended {}.",
            time(&run.ended)
        ),
        Some(run) => format!(
            "{} The last run that used them ended {}.",
            match &history.built_by {
                Some(by) => built_by(by),
                None => "The run that built these artifacts is not in the history.".to_owned(),
            },
            time(&run.ended)
        ),
        None => match &history.built_by {
            Some(by) => built_by(by),
            None => "The history has no run of this pipeline with these parameters.".to_owned(),
        },
    };
    page.line(&format!(
        "{run} Each box shows a stage, its kind and digest, its state in that run, and the time that its build took."
    ));
    let states: Vec<BuildState> = history.stages.iter().map(BuildState::of).collect();
    let counts = [
        (BuildState::Built, "built"),
        (BuildState::Partly, "built in part"),
        (BuildState::Reused, "reused"),
        (BuildState::Missing, "not built"),
    ]
    .map(|(state, text)| (state, states.iter().filter(|f| **f == state).count(), text));
    page.add(html! {
        ul.legend {
            @for (state, n, text) in counts.iter().filter(|(_, n, _)| *n > 0) {
                li class=(state.class()) { i {} (n) " " (text) }
            }
        }
    });
    page.scrolled("The stages of the pipeline and their needs", &draw(history));
}

fn draw(history: &PipelineHistory) -> Markup {
    let needs: Vec<Vec<usize>> = history.stages.iter().map(|stage| stage.needs.clone()).collect();
    let placed = layout(&needs);
    let width = placed.layers as f64 * (WIDTH + BETWEEN) - BETWEEN + 4.0;
    let height = number(placed.height + 4.0, 0);
    let smallest = number(SMALLEST * width, 0);
    let names: Vec<&str> = history.stages.iter().map(|stage| stage.name.as_str()).collect();
    let description = format!("Pipeline of {} stages: {}", names.len(), names.join(", "));
    html! {
        @let style = format!("width:100%;min-width:{smallest}px;max-width:{width}px");
        svg.dag viewBox={ "-2 -2 " (width) " " (height) } width=(width) height=(height) style=(style)
            role="img" aria-label=(description) {
            title { (description) }
            (lines(&placed))
            @for (stage, place) in history.stages.iter().zip(&placed.stages) { (boxed(stage, *place)) }
        }
    }
}

fn left(layer: usize) -> f64 {
    layer as f64 * (WIDTH + BETWEEN)
}

fn lines(placed: &Layout) -> Markup {
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
    html! { path d=(path) {} }
}

fn boxed(stage: &StageRecord, (layer, middle): (usize, f64)) -> Markup {
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
    let why = stage.why.as_ref().map_or_else(String::new, |why| format!(": {why}"));
    let description = format!("{}: {}, {}{why}", stage.name, stage.kind, build_state(stage));
    let digest_at = 10.0 + 6.4 * (stage.kind.chars().count() + 2) as f64;
    let top = number(middle - 0.5 * BOX, 1);
    html! {
        g transform={ "translate(" (left(layer)) " " (top) ")" } {
            title { (description) }
            rect width=(WIDTH) height=(BOX) rx="6" {}
            rect class={ "bar " (BuildState::of(stage).class()) } x="0" y="0" width="5" height=(BOX) rx="2.5" {}
            text.name x=(INDENT) y="21" { (cut(&stage.name, NAME)) }
            text x=(INDENT) y="39" { (stage.kind) }
            text.mono x=(digest_at) y="39" { (digest) }
            text x=(INDENT) y="56" { (cut(&format!("{}{cost}{size}", short(stage)), LINE)) }
        }
    }
}

fn short(stage: &StageRecord) -> String {
    match (&stage.origin, BuildState::of(stage)) {
        (Some(origin), BuildState::Partly) => format!("{}/{} built", origin.built.unwrap_or(0), origin.chunks),
        _ => build_state(stage),
    }
}
