//! The figures and tables of an artifact as in the report of a pipeline, by the same presenters.

use std::path::Path;

use super::artifacts::find_artifact;
use crate::http::{ApiError, Request, Response};
use crate::state::ServerState;
use deaflow_report::{PRESENTERS, Page, RunArtifacts, StageArtifact, figures_beside};

/// Returns the page of an artifact.
///
/// # Errors
/// If the artifact does not exist, is damaged, or does not have the content of its kind.
pub fn figures(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let (store, artifact) = find_artifact(state, digest)?;
    let kind = artifact.kind().to_owned();
    let stages = [StageArtifact {
        stage: format!("{kind} {}", artifact.digest().short()),
        kind: kind.clone(),
        digest: artifact.digest(),
    }];
    let run = RunArtifacts {
        store: &store,
        file: Path::new(""),
        stages: &stages,
        rounds: &[],
    };
    let mut page = Page::new(&stages[0].stage);
    for presenter in PRESENTERS.iter().filter(|presenter| presenter.kind() == kind) {
        for results in presenter.results(&run)? {
            results.text.iter().for_each(|text| page.add_text(text));
        }
        presenter.section(&mut page, &run)?;
    }
    for (caption, drawing) in figures_beside(&run)? {
        page.figure(&caption, &drawing);
    }
    if page.is_empty() {
        page.lead(&format!("Artifacts of kind {kind} have no figures."));
    }
    Ok(Response::Html(page.finish()))
}
