//! A row of a dataset with its label, simulated again on the mesh of the label and on a finer one.

use serde_json::{Value, json};

use super::artifacts::find_artifact;
use crate::artifact_data::{cells_of, field_array, labels, patterns, scene_of};
use crate::http::{ApiError, Array, Request, Response, frame};
use crate::state::ServerState;
use deaflow_base::ArtifactId;
use deaflow_field::{Field, Mesh, Simulation};
use deaflow_pattern::Pattern;
use deaflow_stage::audit::Resimulator;

/// Returns a row and its new simulations as a frame: `?row=`, and `?audit=DIGEST` of an audit that has found the mesh
/// of a dataset without one.
///
/// # Errors
/// If the row does not exist, or cannot be simulated.
pub fn resimulate(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&["row", "audit"])?;
    let (_, set) = find_artifact(state, digest)?;
    let (path, [count, _, _]) = patterns(&set)?;
    let row = request.row(&path, count)?;
    let scene = scene_of(&set)?;
    let pattern = Pattern::of_form(scene.form(), &cells_of(&set, &path, row..row + 1)?)?;
    // Samples of a `sample` stage have no label.
    let label = labels(&set, &path, scene.form(), row..row + 1)
        .ok()
        .map(|mut found| found.swap_remove(0));
    let made_by = made_by(state, request.parameter("audit"))?;
    let resimulator = Resimulator::new(&set, &scene, row, made_by.as_deref());
    let resimulator = resimulator.map_err(|error| ApiError::new(409, error.to_string()))?;
    let own = resimulator.as_labelled(&pattern)?;
    let finer = resimulator.on_finer(&pattern)?;
    let document = document(
        &set.digest(),
        row,
        label.as_ref(),
        (&own, resimulator.mesh),
        (&finer, resimulator.finer),
    );
    let [columns, rows] = pattern.raster().sides();
    let mut arrays = vec![(
        "pattern".to_owned(),
        Array::Bytes(vec![rows, columns], pattern.cells().to_vec()),
    )];
    let field = |found: &Option<Simulation>| found.as_ref().and_then(|found| found.field.clone());
    for (name, field) in [("label", label), ("again", field(&own)), ("finer", field(&finer))] {
        if let Some(field) = field {
            arrays.push((name.to_owned(), field_array(&field)));
        }
    }
    Ok(Response::frame(frame(document, &arrays)))
}

/// A simulation and its mesh, if known.
type OnMesh<'a> = (&'a Option<Simulation>, Option<Mesh>);

fn document(set: &ArtifactId, row: usize, label: Option<&Field>, own: OnMesh<'_>, finer: OnMesh<'_>) -> Value {
    let one = |(found, mesh): OnMesh<'_>| {
        let field = found.as_ref().and_then(|found| found.field.as_ref());
        json!({
            "mesh": mesh.map(|mesh| mesh.to_string()),
            "outcome": found.as_ref().map(|found| found.outcome.kind()),
            "max_displacement_mm": field.map(Field::max_magnitude),
            "max_error_mm": label.zip(field).map(|(label, field)| label.max_difference(field)),
        })
    };
    json!({
        "set": set.to_string(),
        "row": row,
        "label": { "max_displacement_mm": label.map(Field::max_magnitude) },
        "again": one(own),
        "finer": one(finer),
    })
}

/// Returns how the fields were computed, according to an audit.
fn made_by(state: &ServerState, audit: Option<&str>) -> Result<Option<String>, ApiError> {
    let Some(digest) = audit else {
        return Ok(None);
    };
    let (_, audit) = find_artifact(state, digest)?;
    let summary: Option<Value> = audit
        .attribute("summary")
        .and_then(|text| serde_json::from_str(text).ok());
    Ok(summary.and_then(|summary| summary["made_by"].as_str().map(str::to_owned)))
}
