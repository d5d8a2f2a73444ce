//! Predictions of a trained network for patterns whose fields are known: rows of its own datasets, and any other row.

use std::sync::Arc;

use serde_json::json;

use super::artifacts::find_artifact;
use crate::artifact_data::{cells_of, elements, field_array, labels, patterns, scene_of};
use crate::cache::{ModelErrors, score_document};
use crate::http::{ApiError, Array, Request, Response, frame};
use crate::state::ServerState;
use deaflow_content::{ArtifactKind, Training};
use deaflow_dataset::Split;
use deaflow_field::{Field, Predictor};
use deaflow_pattern::Pattern;
use deaflow_store::{Artifact, Data};
use deaflow_surrogate::{PatternScore, Surrogate};

/// Patterns in one response.
const MAX_ROWS: usize = 1000;

/// Returns the errors of a model on the test rows of its own datasets, or on those of `split`: by family, and the
/// `limit` patterns with the largest errors.
///
/// # Errors
/// If the artifact is not a model, or its balanced datasets are missing.
pub fn model_errors(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&["limit", "split"])?;
    let limit = request.integer("limit", 8, MAX_ROWS)?;
    let split = parse_split(request.parameter("split").unwrap_or(Split::Test.name()))?;
    let (store, model) = find_artifact(state, digest)?;
    let key = (model.digest(), split.name());
    let errors = state.model_errors.get_or_insert(&key, || {
        let network = network(state, &model)?;
        ModelErrors::of(&store, &model, &network, split)
    })?;
    Ok(errors.document(limit).into())
}

/// Returns the part of a dataset with a name.
fn parse_split(name: &str) -> Result<Split, ApiError> {
    let known = Split::ALL.into_iter().find(|split| split.name() == name);
    known.ok_or_else(|| {
        let names = Split::ALL.map(Split::name).join(", ");
        ApiError::bad_request(format!("unknown part {name:?} of a dataset")).help(format!("allowed: {names}"))
    })
}

/// Returns the prediction for a row beside its label, as a frame: `?row=`, and `?of=DIGEST` of the dataset; by default
/// it is the first one that the model was trained on.
///
/// # Errors
/// If the row does not exist, or is from another scene.
pub fn prediction(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&["row", "of"])?;
    let (store, model) = find_artifact(state, digest)?;
    let network = network(state, &model)?;
    let set = match request.nonempty("of") {
        Some(of) => find_artifact(state, of)?.1,
        None => ModelErrors::training_sets(&store, &model)?.swap_remove(0),
    };
    // In another scene the prediction would mean nothing.
    let same_scene = network.check_scene(&scene_of(&set)?);
    same_scene.map_err(|error| ApiError::bad_request(error.to_string()))?;
    let (path, [count, _, _]) = patterns(&set)?;
    let row = request.row(&path, count)?;
    let pattern = Pattern::of_form(network.form(), &cells_of(&set, &path, row..row + 1)?)?;
    let label = labels(&set, &path, network.form(), row..row + 1)?.swap_remove(0);
    let label = from_rest(&set, label, row)?;
    let predicted = network.predict(std::slice::from_ref(&pattern))?.swap_remove(0);
    let [columns, rows] = pattern.raster().sides();
    let mut document = score_document(&PatternScore::of(&predicted, &label));
    document["model"] = json!(model.digest().to_string());
    document["set"] = json!(set.digest().to_string());
    document["row"] = json!(row);
    document["network"] = json!(network.kind().name());
    let arrays = [
        (
            "pattern".to_owned(),
            Array::Bytes(vec![rows, columns], pattern.cells().to_vec()),
        ),
        ("label".to_owned(), field_array(&label)),
        ("predicted".to_owned(), field_array(&predicted)),
    ];
    Ok(Response::frame(frame(document, &arrays)))
}

/// Returns a label as networks predict it: from rest, if not all sides are held.
fn from_rest(set: &Artifact, label: Field, row: usize) -> Result<Field, ApiError> {
    if ArtifactKind::Verify.is_of(set) || scene_of(set)?.geometry.sides.is_none() {
        return Ok(label);
    }
    match elements(set, "rest", row..row + 1) {
        Ok(Data::F64(rest)) => Ok(label.plus(-1.0, &Field::from_values(label.raster(), rest)?)),
        _ => Err(ApiError::bad_request(
            "the displacements of this set count from the mount, and this network predicts those from rest",
        )),
    }
}

/// Returns the network of a train stage, from the cache if possible.
fn network(state: &ServerState, model: &Artifact) -> Result<Arc<Surrogate>, ApiError> {
    if !ArtifactKind::Train.is_of(model) {
        return Err(ApiError::bad_request("the artifact is not a trained network")
            .help("GET /api/artifacts?kind=train lists trained networks"));
    }
    state.networks.get_or_insert(&model.digest(), || {
        let weights = Training::open(model)?.weights().read()?;
        Ok(Surrogate::load(&weights)?)
    })
}
