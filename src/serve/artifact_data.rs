//! Reads patterns, fields and scenes of artifacts, row by row.

use std::ops::Range;

use crate::http::{ApiError, Array};
use deaflow_base::ArtifactId;
use deaflow_field::Field;
use deaflow_pattern::PatternForm;
use deaflow_scene::Scene;
use deaflow_stage::direct;
use deaflow_store::{Artifact, Content, Data};

/// Returns the digests of the inputs of an artifact.
///
/// # Errors
/// If its provenance cannot be read.
pub fn inputs_of(artifact: &Artifact) -> Result<Vec<ArtifactId>, ApiError> {
    let provenance = artifact.provenance()?;
    let inputs = provenance.get("inputs").map_or("", String::as_str).lines();
    Ok(inputs.filter_map(|input| input.parse().ok()).collect())
}

/// Reads rows of an array; the array of a manifest is read from its chunks.
///
/// # Errors
/// If there is no such array, or it cannot be read.
pub fn elements(artifact: &Artifact, path: &str, rows: Range<usize>) -> Result<Data, ApiError> {
    let mut found: Option<Data> = None;
    let mut before = 0;
    for chunk in artifact.chunks()? {
        let own = chunk.content(path)?.shape.first().copied().unwrap_or(0);
        let some = rows.start.max(before)..rows.end.min(before + own);
        if some.start < some.end {
            let more = own_elements(chunk, path, some.start - before..some.end - before)?;
            found = Some(match found {
                None => more,
                Some(data) => concatenated(data, more)
                    .ok_or_else(|| ApiError::new(409, format!("the chunks have different types of {path}")))?,
            });
        }
        before += own;
    }
    match found {
        Some(data) => Ok(data),
        None => own_elements(artifact, path, rows),
    }
}

/// Concatenates two arrays of the same type.
fn concatenated(one: Data, other: Data) -> Option<Data> {
    Some(match (one, other) {
        (Data::U8(a), Data::U8(b)) => Data::U8([a, b].concat()),
        (Data::U32(a), Data::U32(b)) => Data::U32([a, b].concat()),
        (Data::U64(a), Data::U64(b)) => Data::U64([a, b].concat()),
        (Data::F32(a), Data::F32(b)) => Data::F32([a, b].concat()),
        (Data::F64(a), Data::F64(b)) => Data::F64([a, b].concat()),
        (Data::Text(a), Data::Text(b)) => Data::Text([a, b].concat()),
        _ => return None,
    })
}

fn own_elements(artifact: &Artifact, path: &str, rows: Range<usize>) -> Result<Data, ApiError> {
    // Checks that the file has not changed since the artifact was opened.
    artifact.file_digest()?;
    Ok(artifact.rows()?.elements(path, rows)?)
}

/// Returns the path of the array of patterns and its shape, which has no zero.
///
/// # Errors
/// If there is no such array.
pub fn patterns(artifact: &Artifact) -> Result<(String, [usize; 3]), ApiError> {
    // The shares of cells that are covered in part have the axes of patterns.
    let is_patterns = |content: &&Content| {
        content.axes.len() == 3 && content.axes[1..] == ["y", "x"] && !content.path.starts_with("covered/")
    };
    let found = artifact.contents()?.iter().find(is_patterns).ok_or_else(no_patterns)?;
    let shape = <[usize; 3]>::try_from(found.shape.as_slice()).ok();
    let shape = shape.filter(|shape| !shape.contains(&0)).ok_or_else(no_patterns)?;
    Ok((found.path.clone(), shape))
}

fn no_patterns() -> ApiError {
    ApiError::not_found("the artifact has no patterns").help("GET /api/artifacts/DIGEST lists its arrays")
}

/// Reads the cells of rows, one row after the other.
///
/// # Errors
/// If they cannot be read.
pub fn cells_of(artifact: &Artifact, path: &str, rows: Range<usize>) -> Result<Vec<u8>, ApiError> {
    match elements(artifact, path, rows)? {
        Data::U8(cells) => Ok(cells),
        _ => Err(no_patterns()),
    }
}

/// Reads the scene of a dataset, from its first chunk if the manifest has none.
///
/// # Errors
/// If there is no scene, or it cannot be simulated.
pub fn scene_of(set: &Artifact) -> Result<Scene, ApiError> {
    let first = set.first_chunk()?;
    let scene = set
        .attribute("scene")
        .or_else(|| first.as_ref().and_then(|chunk| chunk.attribute("scene")));
    let scene = scene.ok_or_else(|| ApiError::bad_request(format!("{} has no scene", set.digest().short())))?;
    Ok(direct::scene_of_text(scene)?)
}

/// Reads the simulated fields of rows in mm.
///
/// # Errors
/// If the patterns have no fields, or they cannot be read.
pub fn labels(set: &Artifact, patterns: &str, form: PatternForm, rows: Range<usize>) -> Result<Vec<Field>, ApiError> {
    let none = || ApiError::not_found("the patterns have no simulated fields");
    let axis = &set.content(patterns)?.axes[0];
    let is_field = |content: &&Content| content.axes.len() == 4 && content.axes[0] == *axis && content.axes[3] == "xy";
    let path = &set.contents()?.iter().find(is_field).ok_or_else(none)?.path;
    let values: Vec<f64> = match elements(set, path, rows)? {
        Data::F32(values) => values.into_iter().map(f64::from).collect(),
        Data::F64(values) => values,
        _ => return Err(none()),
    };
    let fields = values.chunks(2 * form.raster.corners());
    fields
        .map(|values| Ok(Field::from_values(form.raster, values.to_vec())?))
        .collect()
}

/// Returns a field as an array `[y][x][component]` of a frame.
#[must_use]
pub fn field_array(field: &Field) -> Array {
    let [columns, rows] = field.raster().sides();
    let values = field.values().iter().map(|value| *value as f32).collect();
    Array::Numbers(vec![rows + 1, columns + 1, 2], values)
}
