//! The scenes of the sketchpad.

use serde_json::{Value, json};

use super::price::prices;
use super::request::with_effects;
use crate::compute::TIME_LIMIT;
use crate::http::{ApiError, Request, Response};
use crate::left_out::LeftOut;
use crate::state::{NamedScene, ServerState};
use deaflow_fem::effects::EFFECTS;
use deaflow_pattern::{Part, Point, Polygons};
use deaflow_scene::{Scene, Sides};

/// Lists the scenes, the default one first, those of the gallery, the files whose scenes the sketchpad does not show,
/// and those whose scenes cannot be used, with their errors.
///
/// # Errors
/// If the request is invalid.
pub fn scenes(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let read = state.read_scenes();
    let refused = read.invalid.into_iter().map(|(path, error)| {
        let mut document = error.document();
        document["path"] = json!(path);
        document
    });
    Ok(json!({
        "scenes": read.scenes.iter().map(document).collect::<Vec<_>>(),
        "examples": state.examples().iter().map(document).collect::<Vec<_>>(),
        "left_out": read.left_out.iter().map(LeftOut::document).collect::<Vec<_>>(),
        "refused": refused.collect::<Vec<_>>(),
        "time_limit": TIME_LIMIT.as_secs(),
    })
    .into())
}

fn document(named: &NamedScene) -> Value {
    let scene = &named.scene;
    let membrane = scene.membrane();
    let [columns, rows] = membrane.raster.sides();
    let states: Vec<&str> = scene.states.iter().map(|(name, _)| name).collect();
    // The voltage of each electrode group, for each state or for the only drive.
    let in_states = scene.in_states().into_iter();
    let voltages: Vec<Vec<f64>> = in_states.map(|(_, own)| own.drive.voltages.in_volts()).collect();
    let first = scene.in_states().swap_remove(0).1;
    let effect = |effect: &&dyn deaflow_fem::effects::Effect| {
        let on = effect.is_on(&scene.effects, scene);
        // Whether it could be switched on by itself; conflicts of two effects are reported once both are on.
        let refused = match on {
            Some(false) => with_effects(&first, &[effect.name().to_owned()]).err(),
            _ => None,
        };
        json!({
            "name": effect.name(),
            "on": on,
            "refused": refused.map(|error| error.message_with_help()),
            "cost": effect.cost(),
            "in_time": effect.needs_time(),
        })
    };
    json!({
        "name": named.name,
        "text": scene.to_text(),
        "note": named.notes,
        "columns": columns,
        "rows": rows,
        "size_mm": membrane.size_mm,
        "voltage": scene.voltage_v(),
        "driven_by_charge": scene.drive.charge.is_some(),
        "groups": scene.groups(),
        "states": states,
        "voltages": voltages,
        "auto": scene.auto,
        "effects": EFFECTS.iter().map(effect).collect::<Vec<_>>(),
        "parts": parts(scene),
        "borders": borders(scene),
        "sides": scene.geometry.sides.as_ref().map(|given| sides(scene, given)),
        "prices": prices([columns, rows]),
    })
}

/// Returns the support of each side by its name; the place of a load is the share of the side from its lower or left
/// end.
fn sides(scene: &Scene, sides: &Sides) -> Value {
    let size = scene.membrane().size_mm;
    let each = sides.iter().map(|(edge, side)| {
        let place = |at_mm: f64| (0.5 + at_mm / size[1 - edge.normal_axis()]).clamp(0.0, 1.0);
        let load = side
            .force()
            .map(|(force, at_mm)| json!({ "newtons": force, "at": place(at_mm) }));
        (edge.name().to_owned(), json!({ "support": side.name(), "load": load }))
    });
    each.collect()
}

/// Returns the borders of frame and bodies that elements follow, as closed polygons in shares of the sides of the
/// membrane; `None` if these are those of cells.
fn borders(scene: &Scene) -> Option<Value> {
    let borders = scene.geometry.borders(None)?;
    let size = scene.membrane().size_mm;
    let rings = |region: &Polygons| -> Vec<Vec<[f64; 2]>> {
        let ring = |ring: &Vec<Point>| ring.iter().map(|[x, y]| [x / size[0], y / size[1]]).collect();
        region.rings().iter().map(ring).collect()
    };
    Some(json!({
        "opening": borders.opening.as_ref().map(rings),
        "bodies": borders.bodies.iter().map(rings).collect::<Vec<_>>(),
    }))
}

/// Returns what is not membrane, row by row from below: 1 frame, 2 rigid body, else 0; `None` if all is membrane.
fn parts(scene: &Scene) -> Option<Vec<u8>> {
    let parts = scene.parts()?;
    let [columns, rows] = scene.membrane().raster.sides();
    let code = |at: usize| match parts.at(at % columns, at / columns) {
        Part::Frame => 1,
        part if part.body().is_some() => 2,
        _ => 0,
    };
    Some((0..columns * rows).map(code).collect())
}
