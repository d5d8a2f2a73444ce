//! A deformed membrane: its electrode, and the magnitude of the displacement.

use maud::{Markup, html};

use crate::drawing::{Axis, Background, Chart, DeformedMembrane, Sheet, THOUSAND, described, exaggeration, viridis};
use crate::format::mm;

/// Length of the longer side of the membrane, and width of the colour bar.
const SIDE: f64 = 356.4;
const BAR: f64 = 24.0;

/// Length of the longer side of one of several membranes.
const SMALL: f64 = 262.0;

/// Height of the title and the note above a drawing without axes.
const HEAD: f64 = 46.0;

/// The smallest width and height of a frame, fractions of the longer side, because of the ticks.
const SMALLEST: [f64; 2] = [0.2, 0.25];

/// Draws the electrode at rest and deformed, and the magnitude of the displacement.
pub fn membrane_sheet(title: &str, data: &DeformedMembrane) -> Sheet {
    on_a_row(title, data, exaggeration([data]))
}

/// Draws membranes one below the other, with the same exaggeration; also from the side if they leave their plane.
pub fn membranes_sheet(membranes: &[(String, DeformedMembrane)]) -> Sheet {
    let scale = exaggeration(membranes.iter().map(|(_, data)| data));
    let row = |(title, data): &(String, DeformedMembrane)| {
        let drawn = std::iter::once(on_a_row(title, data, scale)).chain(from_the_side(data));
        Sheet::grid(2, drawn.collect())
    };
    Sheet::below(membranes.iter().map(row).collect())
}

/// Draws a membrane from the side; `None` of one in its plane.
fn from_the_side(data: &DeformedMembrane) -> Option<Sheet> {
    let scale = data.height_scale()?;
    let (drawn, [left, top, width, height]) = data.from_the_side(scale);
    let factor = SIDE / width;
    let place = format!(
        "translate(0 {HEAD}) scale({factor:.4}) translate({:.1} {:.1})",
        -left, -top
    );
    let note = format!("highest {} mm, heights {}", mm(data.highest()), times(scale));
    Some(Sheet {
        size: [SIDE, HEAD + factor * height],
        markup: html! {
            g.chart {
                text class="title" x="0" y="20" { "From the side" }
                text x="0" y="37" { (note) }
                g.membrane transform=(place) { (drawn) }
            }
        },
    })
}

/// Says by what factor something is drawn larger.
fn times(scale: f64) -> String {
    match scale > 1.0 {
        true => format!("×{scale:.0}"),
        false => "true to scale".to_owned(),
    }
}

fn on_a_row(title: &str, data: &DeformedMembrane, scale: f64) -> Sheet {
    let charts = [
        electrode(title, data, scale, SIDE),
        magnitude(data, scale),
        colour_bar(data.largest(), SIDE * frame_fractions(data.background())[1]),
    ];
    Sheet::charts(3, &charts)
}

/// Draws some named membranes deformed, with their largest displacements and the same exaggeration.
pub(crate) fn membranes_charts(named: &[(String, DeformedMembrane)]) -> Vec<Chart> {
    let scale = exaggeration(named.iter().map(|(_, membrane)| membrane));
    let drawn = |(name, membrane): &(String, DeformedMembrane)| {
        let chart = electrode(name, membrane, scale, SMALL);
        let note = format!("largest {} mm, {}", mm(membrane.largest()), chart.note);
        chart.with_note(note)
    };
    named.iter().map(drawn).collect()
}

/// Draws the deformed electrode with its outline at rest, and the displacements of the points of the objective.
pub(super) fn electrode(title: &str, data: &DeformedMembrane, scale: f64, side: f64) -> Chart {
    let factor = if scale > 1.0 { "displacements " } else { "" }.to_owned() + &times(scale);
    // There is no space for both.
    let grey = match data.background().sides() {
        None => "grey: at rest",
        // Displacements of designs count from rest, but are drawn on the membrane as it is mounted.
        Some(_) => "grey: mounted",
    };
    let more = data.state().map_or(grey.to_owned(), |state| format!("state {state}"));
    let note = format!("area {:.1} %, {factor}, {more}", 100.0 * data.area());
    let inside =
        html! { (data.electrode(scale)) (data.outline("ghost", 0.0)) (data.sides(scale)) (data.arrows(scale)) };
    on_membrane(title, note, data.background(), inside, side)
}

fn magnitude(data: &DeformedMembrane, scale: f64) -> Chart {
    let note = match data.points()[..] {
        [p] => {
            let u = data.at(p);
            format!("({}, {}) mm moves by ({}, {}) mm", p[0], p[1], mm(u[0]), mm(u[1]))
        }
        _ => format!("largest {} mm", mm(data.largest())),
    };
    let inside =
        html! { (data.magnitudes(scale)) (data.outline("light", scale)) (data.sides(scale)) (data.arrows(scale)) };
    let mut chart = on_membrane("Magnitude of the displacement", note, data.background(), inside, SIDE);
    if let Some(sides) = data.background().sides() {
        chart.x = chart.x.with_label(&format!("x [mm]; {}", described(sides)));
    }
    chart
}

/// Returns width and height of a frame, fractions of the longer side of the membrane.
fn frame_fractions(background: &Background) -> [f64; 2] {
    let size = background.size_mm();
    [0, 1].map(|axis| (size[axis] / background.side()).max(SMALLEST[axis]))
}

fn on_membrane(title: &str, note: String, background: &Background, inside: Markup, side: f64) -> Chart {
    let [across, up] = frame_fractions(background);
    let axis = |name: &str, fraction: f64| Axis::linear(&format!("{name} [mm]"), 0.0, fraction * background.side());
    let mut chart = Chart::new(title, [axis("x", across), axis("y", up)], Vec::new())
        .with_note(note)
        .with_frame([across, up].map(|fraction| fraction * side));
    let drawn = html! { g.membrane { (background.draw_frame()) (inside) } };
    // The drawing is a square with the membrane at its lower left.
    chart.inside = Some(match [across, up] == [1.0; 2] {
        true => drawn,
        false => {
            let place = format!(
                "scale({} {}) translate(0 {})",
                1.0 / across,
                1.0 / up,
                THOUSAND * (up - 1.0)
            );
            html! { g transform=(place) { (drawn) } }
        }
    });
    chart
}

fn colour_bar(largest: f64, height: f64) -> Chart {
    const STEPS: u32 = 200;
    let high = if largest > 0.0 { largest } else { 1.0 };
    let axes = [Axis::names(Vec::new()), Axis::linear("|u| [mm]", 0.0, high)];
    let mut chart = Chart::new("", axes, Vec::new());
    let step = |k: u32| f64::from(k) / f64::from(STEPS);
    chart.inside = Some(html! {
        g shape-rendering="crispEdges" {
            @for k in 0..STEPS {
                @let (y, height) = (1000.0 * (1.0 - step(k + 1)), 1000.0 / f64::from(STEPS));
                rect x="0" y=(y) width="1000" height=(height) fill=(viridis(step(k))) {}
                }
        }
    });
    chart.with_frame([BAR, height])
}
