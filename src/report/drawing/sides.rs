//! The sides of a membrane that are not all held: each is drawn as what supports it.

use maud::{Markup, html};

use super::path::{head, number, path};
use deaflow_pattern::Point;
use deaflow_scene::{Edge, SideSupport, Sides};

/// Points of a line along a side, which may be deformed, and rollers along it.
const PIECES: usize = 24;
const ROLLERS: usize = 6;

/// Length of the arrow of a load, in thousandths of the longer side of the membrane.
const LOAD: f64 = 90.0;

/// What the lines mean, for readers of a drawing.
pub const LEGEND: &str = "Sides: a thick grey line is held, a thin one is free, circles are rollers, a thick dark line \
                          is a rigid bar; a dark arrow is a load.";

/// Draws all sides of a membrane of a size in mm; `to` maps a point in mm to the drawing.
pub fn draw(sides: &Sides, size: [f64; 2], to: impl Fn(Point) -> (f64, f64)) -> Markup {
    let along = |edge: Edge, share: f64| {
        let [from, end] = edge
            .ends([1, 1])
            .map(|ends| [0, 1].map(|axis| ends[axis] as f64 * size[axis]));
        to([0, 1].map(|axis| from[axis] + share * (end[axis] - from[axis])))
    };
    let line = |edge| {
        let points = (0..=PIECES).map(|k| along(edge, k as f64 / PIECES as f64));
        path(&points.collect::<Vec<_>>(), false)
    };
    html! {
        @for (edge, side) in sides.iter() {
            path class=(class(side)) d=(line(edge)) {}
            @if *side == SideSupport::Roller {
                @for k in 0..ROLLERS {
                    @let (x, y) = along(edge, (k as f64 + 0.5) / ROLLERS as f64);
                    circle class="roller" cx=(number(x, 0)) cy=(number(y, 0)) r="11" {}
                }
            }
        }
        @for (edge, side) in sides.iter() {
            @if let Some((force, at_mm)) = side.force() {
                @let length = size[1 - edge.normal_axis()];
                (arrow(along(edge, (0.5 + at_mm / length).clamp(0.0, 1.0)), force, edge.normal()))
            }
        }
    }
}

/// Returns what supports each side, in words.
#[must_use]
pub fn described(sides: &Sides) -> String {
    let mut groups: Vec<(&str, Vec<&str>)> = Vec::new();
    for (edge, side) in sides.iter() {
        match groups.iter_mut().find(|(word, _)| *word == side.name()) {
            Some((_, edges)) => edges.push(edge.name()),
            None => groups.push((side.name(), vec![edge.name()])),
        }
    }
    let listed = groups
        .iter()
        .map(|(word, edges)| format!("{word}: {}", edges.join(", ")));
    listed.collect::<Vec<_>>().join("; ")
}

fn class(side: &SideSupport) -> &'static str {
    match side {
        SideSupport::Held => "clamp",
        SideSupport::Free | SideSupport::Load(_) | SideSupport::Roller => "free",
        SideSupport::Bar(_) => "bar",
    }
}

/// Draws the arrow of a force within the membrane: it pulls with its tip at the side, or pushes from there.
fn arrow((x, y): (f64, f64), force: [f64; 2], outwards: [f64; 2]) -> Markup {
    let magnitude = force[0].hypot(force[1]);
    let (dx, dy) = (LOAD * force[0] / magnitude, -LOAD * force[1] / magnitude);
    let pulls = force[0] * outwards[0] + force[1] * outwards[1] >= 0.0;
    let (from, tip) = match pulls {
        true => ((x - dx, y - dy), (x, y)),
        false => ((x, y), (x + dx, y + dy)),
    };
    let (base, head) = head(from, tip);
    html! {
        path class="load" d=(path(&[from, base], false)) {}
        path class="tip" d=(head) {}
    }
}
