//! Artifacts: which there are, and what is known of one.

use std::collections::BTreeSet;
use std::sync::Arc;

use serde_json::{Value, json};

use crate::http::{Answer, Refusal, Request};
use crate::state::ServedState;
use deaflow_base::ArtifactId;
use deaflow_store::{Ancestor, Artifact, Content, Store};

/// Artifacts in one answer.
const MOST: usize = 5000;

/// Runs that are looked through.
const MOST_RUNS: usize = 200;

/// The fewest digits that name an artifact.
const LEAST: usize = 4;

/// What the last runs made, each once, the latest first. `?limit=` and `?offset=` take some, `?kind=` those of a kind.
///
/// # Errors
/// When the store cannot be read.
pub fn artifacts(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&["limit", "offset", "kind"])?;
    let (limit, offset) = (
        request.number("limit", 500, MOST)?,
        request.number("offset", 0, usize::MAX)?,
    );
    let Some(store) = state.store()? else {
        return Ok(json!({ "artifacts": [], "total": 0 }).into());
    };
    let mut seen: BTreeSet<ArtifactId> = BTreeSet::new();
    let mut found: Vec<Value> = Vec::new();
    for run in store.runs()?.take(MOST_RUNS) {
        let run = run?;
        let wanted = run
            .stages
            .iter()
            .rev()
            .filter(|stage| request.word("kind").is_none_or(|kind| stage.kind == kind));
        for stage in wanted {
            if seen.insert(stage.artifact) {
                found.push(json!({
                    "digest": stage.artifact.to_string(),
                    "kind": stage.kind,
                    "stage": stage.name,
                    "pipeline": run.pipeline,
                    "run": run.id,
                    "created": run.created,
                    "overrides": run.overrides,
                }));
            }
        }
    }
    let total = found.len();
    let some: Vec<Value> = found.into_iter().skip(offset).take(limit).collect();
    Ok(json!({ "artifacts": some, "total": total }).into())
}

/// The artifact that digits name: all of its digest, or its beginning.
///
/// # Errors
/// When they name none, or several, or it is damaged.
pub fn named(state: &ServedState, digits: &str) -> Result<(Arc<Store>, Artifact), Refusal> {
    let is_digest = digits.len() >= LEAST && digits.len() <= 64 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    if !is_digest {
        return Err(
            Refusal::absent(format!("{digits:?} is no digest")).help(format!("{LEAST} to 64 hexadecimal digits"))
        );
    }
    let store = state.existing_store()?;
    let digest = match store.find(&digits.to_ascii_lowercase())?.as_slice() {
        [one] => *one,
        [] => {
            return Err(
                Refusal::absent(format!("no artifact has a digest that begins with {digits}"))
                    .help("GET /api/artifacts lists those of the last runs"),
            );
        }
        several => {
            let told = format!("{} artifacts have a digest that begins with {digits}", several.len());
            return Err(Refusal::absent(told).help("give more digits"));
        }
    };
    if let Some(known) = state.opened.get(&digest) {
        return Ok((store, known.as_ref().clone()));
    }
    let artifact = store.artifact(&digest)?;
    state.opened.put(digest, &Arc::new(artifact.clone()));
    Ok((store, artifact))
}

/// The stage that made an artifact, as the last runs know it.
fn made_by(store: &Store, artifact: &ArtifactId) -> Result<Option<String>, Refusal> {
    for run in store.runs()?.take(MOST_RUNS) {
        let made = run?.stages.into_iter().rev().find(|stage| stage.artifact == *artifact);
        if let Some(stage) = made {
            return Ok(Some(stage.name));
        }
    }
    Ok(None)
}

/// Kind, attributes, datasets, provenance, everything that it was made from, and the stage that made it.
///
/// # Errors
/// When it is not there, or damaged.
pub fn artifact(state: &ServedState, request: &Request, digits: &str) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let (store, artifact) = named(state, digits)?;
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
        "datasets": datasets,
        "provenance": artifact.provenance()?,
        "ancestry": ancestry,
    })
    .into())
}
