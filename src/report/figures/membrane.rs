//! A membrane, deformed: the electrode moved by its displacement field, and where it moves how far.

use std::path::Path;

use maud::{Markup, html};

use crate::report::drawing::{Axis, Chart, FigureError, Ground, Membrane, Sheet, exaggeration, viridis};

/// Side of the membrane, and width of the frame of the colour bar.
const SIDE: f64 = 356.4;
const BAR: f64 = 24.0;

/// The electrode at rest and deformed, and the magnitude of the displacement.
pub fn membrane_drawing(title: &str, data: &Membrane) -> Sheet {
    let scale = exaggeration([data]);
    let charts = [
        electrode(title, data, scale),
        magnitude(data, scale),
        colour_bar(data.largest()),
    ];
    Sheet::charts(3, &charts)
}

/// Draws a membrane.
///
/// # Errors
/// When the file cannot be written.
pub fn draw_membrane(path: &Path, title: &str, data: &Membrane) -> Result<(), FigureError> {
    membrane_drawing(title, data).write_png(path)
}

/// The electrode where it has moved to with its outline at rest, and the arrows of the wanted points.
pub(super) fn electrode(title: &str, data: &Membrane, scale: f64) -> Chart {
    let factor = if scale > 1.0 {
        format!("displacements ×{scale:.0}")
    } else {
        "true to scale".into()
    };
    let state = data.state().map_or(String::new(), |state| format!(", state {state}"));
    let note = format!("area {:.1} %{state}, {factor}, grey: at rest", 100.0 * data.area());
    let inside = html! { (data.electrode(scale)) (data.outline("ghost", 0.0)) (data.arrows(scale)) };
    on_membrane(title, note, data.ground(), inside)
}

fn magnitude(data: &Membrane, scale: f64) -> Chart {
    let note = match data.points()[..] {
        [p] => {
            let u = data.at(p);
            format!(
                "({}, {}) mm moves by ({:.3}, {:.3}) mm",
                p[0],
                p[1],
                u[0] + 0.0,
                u[1] + 0.0
            )
        }
        _ => format!("largest {:.3} mm", data.largest()),
    };
    let inside = html! { (data.magnitudes(scale)) (data.outline("light", scale)) (data.arrows(scale)) };
    on_membrane("Magnitude of the displacement", note, data.ground(), inside)
}

fn on_membrane(title: &str, note: String, ground: &Ground, inside: Markup) -> Chart {
    let axis = |name: &str| Axis::linear(&format!("{name} [mm]"), 0.0, ground.side());
    let mut chart = Chart::new(title, [axis("x"), axis("y")], Vec::new())
        .with_note(note)
        .square(SIDE);
    chart.inside = Some(html! { g.membrane { (ground.frame()) (inside) } });
    chart
}

fn colour_bar(largest: f64) -> Chart {
    const STEPS: u32 = 200;
    let high = if largest > 0.0 { largest } else { 1.0 };
    let axes = [Axis::names(Vec::new()), Axis::linear("|u| [mm]", 0.0, high)];
    let mut chart = Chart::new("", axes, Vec::new());
    let step = |k: u32| f64::from(k) / f64::from(STEPS);
    chart.inside = Some(html! {
        g shape-rendering="crispEdges" {
            @for k in 0..STEPS {
                rect x="0" y=(1000.0 * (1.0 - step(k + 1))) width="1000" height=(1000.0 / f64::from(STEPS)) fill=(viridis(step(k))) {}
            }
        }
    });
    chart.with_frame([BAR, SIDE])
}
