//! Artifacts: the list, and the details of one.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use serde_json::{Value, json};

use super::runs::opening_document;
use crate::artifact_data::scene_of;
use crate::http::{ApiError, Request, Response};
use crate::state::ServerState;
use deaflow_base::{ArtifactId, readable_time};
use deaflow_content::{ArtifactKind, Designs, LongTexts, Verification};
use deaflow_report::{Objective, RemovedArtifacts, RunArtifacts, StageArtifact};
use deaflow_store::{Ancestor, Artifact, Content, RemovedArtifact, Store};

/// Artifacts in one response.
const MAX_ARTIFACTS: usize = 5000;

/// Runs that are searched.
const MAX_RUNS: usize = 200;

/// The shortest abbreviation of a digest.
const MIN_DIGITS: usize = 4;

/// Lists the artifacts of the last runs, each once, the latest first; parameters `limit`, `offset` and `kind`. Those
/// that `gc` removed have the time as `removed`.
///
/// # Errors
/// If the store cannot be read.
pub fn artifacts(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&["limit", "offset", "kind"])?;
    let (limit, offset) = (
        request.integer("limit", 500, MAX_ARTIFACTS)?,
        request.integer("offset", 0, usize::MAX)?,
    );
    let Some(store) = state.store()? else {
        return Ok(json!({ "artifacts": [], "total": 0 }).into());
    };
    let removed = RemovedArtifacts::of(&store);
    let mut seen: BTreeSet<ArtifactId> = BTreeSet::new();
    let mut found: Vec<Value> = Vec::new();
    for run in store.runs()?.take(MAX_RUNS) {
        let run = run?;
        let matching = run
            .stages
            .iter()
            .rev()
            .filter(|stage| request.parameter("kind").is_none_or(|kind| stage.kind == kind));
        for stage in matching {
            if seen.insert(stage.artifact) {
                found.push(json!({
                    "digest": stage.artifact.to_string(),
                    "kind": stage.kind,
                    "stage": stage.name,
                    "pipeline": run.pipeline,
                    "run": run.id,
                    "created": run.created,
                    "overrides": run.overrides,
                    "removed": removed.at(&stage.artifact),
                }));
            }
        }
    }
    let total = found.len();
    let page: Vec<Value> = found.into_iter().skip(offset).take(limit).collect();
    Ok(json!({ "artifacts": page, "total": total }).into())
}

/// Finds the artifact with a digest, or with an abbreviated one.
///
/// # Errors
/// If no artifact or several have it, or the artifact is damaged.
pub fn find_artifact(state: &ServerState, digits: &str) -> Result<(Arc<Store>, Artifact), ApiError> {
    let is_digest = (MIN_DIGITS..=64).contains(&digits.len()) && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    if !is_digest {
        let help = format!("give {MIN_DIGITS} to 64 hexadecimal digits");
        return Err(ApiError::not_found(format!("{digits:?} is not a digest")).help(help));
    }
    let store = state.existing_store()?;
    let digest = match store.find(&digits.to_ascii_lowercase())?.as_slice() {
        [one] => *one,
        [] => return Err(not_found(&store, &digits.to_ascii_lowercase())),
        several => {
            let message = format!("{} artifacts have a digest that begins with {digits}", several.len());
            return Err(ApiError::not_found(message).help("give more digits"));
        }
    };
    let artifact = state.opened.get_or_insert(&digest, || store.artifact(&digest))?;
    Ok((store, artifact.as_ref().clone()))
}

/// The error about an artifact that is not there; it tells when `gc` has removed it, as the commands do.
fn not_found(store: &Store, digits: &str) -> ApiError {
    let mut removed = store.removed().into_iter();
    match removed.rfind(|removed| removed.digest.to_string().starts_with(digits)) {
        Some(RemovedArtifact { digest, kind, at, .. }) => {
            let kind = if kind.is_empty() { kind } else { format!(" ({kind})") };
            let (digest, at) = (digest.short(), readable_time(&at));
            ApiError::not_found(format!("artifact {digest}{kind} was removed by gc at {at}"))
                .help("build it again with `deaflow run`; `deaflow pin` protects artifacts from gc")
        }
        None => ApiError::not_found(format!("no artifact has a digest that begins with {digits}"))
            .help("GET /api/artifacts lists the artifacts of the last runs"),
    }
}

/// Returns what a report of the artifact alone begins with: `sentence`, `facts`, `picture` and `caption`, as for a run.
///
/// # Errors
/// If it does not exist, or is damaged.
pub fn artifact_opening(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let (store, artifact) = find_artifact(state, digest)?;
    let stages = [StageArtifact {
        stage: artifact.digest().short(),
        kind: artifact.kind().to_owned(),
        digest: artifact.digest(),
    }];
    let alone = RunArtifacts {
        store: &store,
        file: Path::new(""),
        stages: &stages,
        rounds: &[],
    };
    Ok(opening_document(&alone)?.into())
}

/// Returns the name of the stage that built an artifact, according to the last runs.
fn made_by(store: &Store, artifact: &ArtifactId) -> Result<Option<String>, ApiError> {
    for run in store.runs()?.take(MAX_RUNS) {
        let made = run?.stages.into_iter().rev().find(|stage| stage.artifact == *artifact);
        if let Some(stage) = made {
            return Ok(Some(stage.name));
        }
    }
    Ok(None)
}

/// Returns the objectives of designs: for each text in the syntax of pipelines its `words`, and `degrees_per_mm` if its
/// values are arc lengths of rotations. Objectives that cannot be read are left out, as the page shows their texts.
fn objectives(artifact: &Artifact) -> BTreeMap<String, Value> {
    let texts = match ArtifactKind::of(artifact) {
        Some(ArtifactKind::Design) => Designs::open(artifact).and_then(|view| view.rows().objective().read()),
        Some(ArtifactKind::Verify) => Verification::open(artifact).and_then(|view| view.rows().objective().read()),
        _ => return BTreeMap::new(),
    };
    let (Ok(LongTexts(mut texts)), Ok(scene)) = (texts, scene_of(artifact)) else {
        return BTreeMap::new();
    };
    texts.sort_unstable();
    texts.dedup();
    let described = texts.into_iter().filter_map(|text| {
        let read = Objective::read(&text, &scene).ok()?;
        let described = json!({ "words": read.words(), "degrees_per_mm": read.degrees(1.0) });
        Some((text, described))
    });
    described.collect()
}

/// Returns kind, attributes, datasets, provenance, ancestry and stage of an artifact, the area of the membrane that is
/// neither frame nor body if it has a scene, and the objectives of designs in words.
///
/// # Errors
/// If it does not exist, or is damaged.
pub fn artifact(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let (store, artifact) = find_artifact(state, digest)?;
    let dataset = |content: &Content| {
        json!({
            "path": content.path,
            "type": content.kind.name(),
            "shape": content.shape,
            "axes": content.axes,
            "units": content.units,
            "description": content.description,
        })
    };
    let ancestor = |ancestor: &Ancestor| {
        json!({
            "digest": ancestor.artifact.to_string(),
            "kind": ancestor.entry("kind"),
            "inputs": ancestor.inputs.iter().map(ArtifactId::to_string).collect::<Vec<_>>(),
            "entries": ancestor.entries,
        })
    };
    let datasets: Vec<Value> = artifact.contents()?.iter().map(dataset).collect();
    let ancestry: Vec<Value> = store.ancestry(&artifact)?.iter().map(ancestor).collect();
    Ok(json!({
        "digest": artifact.digest().to_string(),
        "kind": artifact.kind(),
        "stage": made_by(&store, &artifact.digest())?,
        "attributes": artifact.attributes(),
        "parts": artifact.parts().iter().map(ArtifactId::to_string).collect::<Vec<_>>(),
        "free_area_mm2": scene_of(&artifact).ok().map(|scene| scene.free_area_mm2()),
        "objectives": objectives(&artifact),
        "datasets": datasets,
        "provenance": artifact.provenance()?,
        "ancestry": ancestry,
    })
    .into())
}
