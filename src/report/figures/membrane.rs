//! A membrane, deformed: the electrode moved by its displacement field, and where it moves how far.

use std::path::Path;

use maud::{Markup, html};

use crate::drawing::{Axis, Chart, FigureError, Ground, Membrane, Sheet, THOUSAND, exaggeration, viridis};

/// Longer side of the membrane, and width of the frame of the colour bar.
const SIDE: f64 = 356.4;
const BAR: f64 = 24.0;

/// The least width and height of a frame, shares of the longer side: ticks stand beside it.
const LEAST: [f64; 2] = [0.2, 0.25];

/// The electrode at rest and deformed, and the magnitude of the displacement.
pub fn membrane_drawing(title: &str, data: &Membrane) -> Sheet {
    let scale = exaggeration([data]);
    let charts = [
        electrode(title, data, scale, SIDE),
        magnitude(data, scale),
        colour_bar(data.largest(), SIDE * shares(data.ground())[1]),
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

/// The electrode where it has moved to with its outline at rest, and the arrows of the wanted points; the longer side of the membrane so long.
pub(super) fn electrode(title: &str, data: &Membrane, scale: f64, side: f64) -> Chart {
    let factor = if scale > 1.0 {
        format!("displacements ×{scale:.0}")
    } else {
        "true to scale".into()
    };
    // Both do not fit in a line.
    let more = data
        .state()
        .map_or("grey: at rest".to_owned(), |state| format!("state {state}"));
    let note = format!("area {:.1} %, {factor}, {more}", 100.0 * data.area());
    let inside = html! { (data.electrode(scale)) (data.outline("ghost", 0.0)) (data.arrows(scale)) };
    on_membrane(title, note, data.ground(), inside, side)
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
    on_membrane("Magnitude of the displacement", note, data.ground(), inside, SIDE)
}

/// Width and height of a frame, shares of the longer side of the membrane.
fn shares(ground: &Ground) -> [f64; 2] {
    let size = ground.size_mm();
    [0, 1].map(|axis| (size[axis] / ground.side()).max(LEAST[axis]))
}

fn on_membrane(title: &str, note: String, ground: &Ground, inside: Markup, side: f64) -> Chart {
    let [across, up] = shares(ground);
    let axis = |name: &str, share: f64| Axis::linear(&format!("{name} [mm]"), 0.0, share * ground.side());
    let mut chart = Chart::new(title, [axis("x", across), axis("y", up)], Vec::new())
        .with_note(note)
        .with_frame([across, up].map(|share| share * side));
    let drawn = html! { g.membrane { (ground.frame()) (inside) } };
    // Drawings are in a square at whose lower left corner the membrane lies.
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
                rect x="0" y=(1000.0 * (1.0 - step(k + 1))) width="1000" height=(1000.0 / f64::from(STEPS)) fill=(viridis(step(k))) {}
            }
        }
    });
    chart.with_frame([BAR, height])
}
