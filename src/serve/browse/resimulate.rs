//! A row of a dataset as it is labelled, and as an audit simulates it again: on the mesh of its label, and on a finer one.

use serde_json::{Value, json};

use super::artifacts::named;
use super::judged::{labels, pattern, scene_of};
use super::neighbours::{cells_of, patterns};
use crate::http::{Answer, Array, Refusal, Request, frame};
use crate::state::ServedState;
use deaflow_base::ArtifactId;
use deaflow_field::{Field, Mesh, Simulation};
use deaflow_stage::audit;

/// A row beside what comes out when it is simulated again, as a frame: `?row=`, and `?audit=DIGEST` of an audit that has found out the mesh of
/// a dataset which does not say it.
///
/// # Errors
/// When there is no such row, or it cannot be simulated.
pub fn again(state: &ServedState, request: &Request, digits: &str) -> Result<Answer, Refusal> {
    request.allow(&["row", "audit"])?;
    let (_, set) = named(state, digits)?;
    let (path, [count, _, _]) = patterns(&set)?;
    let row = request.word("row").and_then(|row| row.parse().ok());
    let row: usize = row
        .filter(|row| *row < count)
        .ok_or_else(|| Refusal::absent(format!("{path} has no such row")).help(format!("rows 0 to {}", count - 1)))?;
    let scene = scene_of(&set)?;
    let pattern = pattern(scene.form(), &cells_of(&set, &path, row..row + 1)?)?;
    // A sample alone has no label.
    let label = labels(&set, &path, scene.form(), row..row + 1)
        .ok()
        .map(|mut found| found.swap_remove(0));
    let made_by = made_by(state, request.word("audit"))?;
    let setting = audit::again(&set, &scene, row, made_by.as_deref());
    let setting = setting.map_err(|error| Refusal::new(409, error.to_string()))?;
    let failed = |error: deaflow_field::SimulatorError| Refusal::new(409, error.to_string());
    let own = setting.as_labelled(&pattern).map_err(failed)?;
    let finer = setting.on_finer(&pattern).map_err(failed)?;
    let document = document(
        &set.digest(),
        row,
        label.as_ref(),
        (&own, setting.mesh),
        (&finer, setting.finer),
    );
    let [columns, rows] = pattern.raster().sides();
    let mut arrays = vec![(
        "pattern".to_owned(),
        Array::Bytes(vec![rows, columns], pattern.cells().to_vec()),
    )];
    let field = |found: &Option<Simulation>| found.as_ref().and_then(|found| found.field.clone());
    for (name, field) in [("label", label), ("again", field(&own)), ("finer", field(&finer))] {
        if let Some(field) = field {
            let values = field.values().iter().map(|value| *value as f32).collect();
            arrays.push((name.to_owned(), Array::Numbers(vec![rows + 1, columns + 1, 2], values)));
        }
    }
    Ok(Answer::frame(frame(document, &arrays)))
}

/// A simulation and its mesh, each where there is one.
type On<'a> = (&'a Option<Simulation>, Option<Mesh>);

fn document(set: &ArtifactId, row: usize, label: Option<&Field>, own: On<'_>, finer: On<'_>) -> Value {
    let told = |(found, mesh): On<'_>| {
        let field = found.as_ref().and_then(|found| found.field.as_ref());
        json!({
            "mesh": mesh.map(|mesh| mesh.to_string()),
            "outcome": found.as_ref().map(|found| found.outcome.name()),
            "max_displacement_mm": field.map(Field::max_magnitude),
            "max_error_mm": label.zip(field).map(|(label, field)| label.max_difference(field)),
        })
    };
    json!({
        "set": set.to_string(),
        "row": row,
        "label": { "max_displacement_mm": label.map(Field::max_magnitude) },
        "again": told(own),
        "finer": told(finer),
    })
}

/// What an audit says of how the fields were found.
fn made_by(state: &ServedState, audit: Option<&str>) -> Result<Option<String>, Refusal> {
    let Some(digits) = audit.filter(|digits| !digits.is_empty()) else {
        return Ok(None);
    };
    let (_, audit) = named(state, digits)?;
    let summary: Option<Value> = audit
        .attribute("summary")
        .and_then(|text| serde_json::from_str(text).ok());
    Ok(summary.and_then(|summary| summary["made_by"].as_str().map(str::to_owned)))
}
