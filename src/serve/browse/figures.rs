//! An artifact as the report of a pipeline shows it: the same charts and tables, by the same presenters.

use std::path::Path;

use super::artifacts::named;
use crate::http::{Answer, Refusal, Request};
use crate::state::ServedState;
use deaflow_report::{Made, PRESENTERS, Page, RunArtifacts};

/// The page of an artifact. What has no presenter, or nothing to show, says so.
///
/// # Errors
/// When it is not there, damaged, or does not hold what its kind promises.
pub fn page(state: &ServedState, request: &Request, digits: &str) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let (store, artifact) = named(state, digits)?;
    let kind = artifact.kind().to_owned();
    let made = [Made {
        stage: format!("{kind} {}", artifact.digest().short()),
        kind: kind.clone(),
        digest: artifact.digest(),
    }];
    let run = RunArtifacts {
        store: &store,
        file: Path::new(""),
        made: &made,
        rounds: &[],
    };
    let mut page = Page::new(&made[0].stage);
    for presenter in PRESENTERS.iter().filter(|presenter| presenter.kind() == kind) {
        for results in presenter.results(&run)? {
            results.text.iter().for_each(|text| page.add_text(text));
        }
        presenter.section(&mut page, &run)?;
    }
    if page.is_empty() {
        page.lead(&format!("What a stage of kind {kind} makes has no figures."));
    }
    Ok(Answer::Page(page.finish()))
}
