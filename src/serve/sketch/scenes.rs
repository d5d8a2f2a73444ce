//! What can be drawn on.

use serde_json::{Value, json};

use super::drawn::with_effects;
use crate::http::{Answer, Refusal, Request};
use crate::state::{NamedScene, ServedState};
use deaflow_fem::effects::EFFECTS;
use deaflow_pattern::Part;
use deaflow_scene::Scene;

/// The scenes, the first of which is that of a sketch which names none, and the files whose scenes cannot be used, each with its problem.
///
/// # Errors
/// When the request is not understood.
pub fn scenes(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let scenes: Vec<Value> = state.read_scenes().iter().map(document).collect();
    let refused = state.refused_scenes().into_iter().map(|(path, refusal)| {
        let mut document = refusal.document();
        document["path"] = json!(path);
        document
    });
    Ok(json!({ "scenes": scenes, "refused": refused.collect::<Vec<_>>() }).into())
}

fn document(named: &NamedScene) -> Value {
    let scene = &named.scene;
    let membrane = scene.membrane();
    let [columns, rows] = membrane.raster.sides();
    let states: Vec<&str> = scene.states.iter().map(|(name, _)| name).collect();
    // Of each state, or of the one drive, the voltage of each group of electrodes.
    let in_states = scene.in_states().into_iter();
    let voltages: Vec<Vec<f64>> = in_states.map(|(_, own)| own.drive.voltages.in_volts()).collect();
    let first = scene.in_states().swap_remove(0).1;
    let effect = |effect: &&dyn deaflow_fem::effects::Effect| {
        let on = effect.is_on(&scene.effects, scene);
        // Whether it could be switched on by itself; what two of them are to each other is told once both are.
        let refused = match on {
            Some(false) => with_effects(&first, &[effect.name().to_owned()]).err(),
            _ => None,
        };
        json!({
            "name": effect.name(),
            "on": on,
            "refused": refused.map(|refusal| refusal.words()),
            "cost": effect.cost(),
            "in_time": effect.needs_time(),
        })
    };
    json!({
        "name": named.name,
        "text": scene.to_text(),
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
    })
}

/// What is not membrane, row by row from below: 1 frame, 2 rigid body, else 0; none where all is membrane.
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
