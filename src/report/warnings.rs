//! What the simulations of a run left out although it matters, as their artifacts say.

use super::gather::{Made, ReportError};
use crate::store::Store;

/// The warnings of all stages that simulate, each once, after the names of the stages that it belongs to.
///
/// # Errors
/// When an artifact cannot be read.
pub fn warnings(store: &Store, made: &[Made]) -> Result<Vec<String>, ReportError> {
    let mut found: Vec<(String, Vec<&str>)> = Vec::new();
    for stage in made
        .iter()
        .filter(|stage| ["solve", "verify"].contains(&stage.kind.as_str()))
    {
        let artifact = store.artifact(&stage.digest)?;
        // All chunks of a stage are simulated alike.
        let first = match artifact.parts().first() {
            Some(part) => store.artifact(part)?,
            None => artifact,
        };
        for line in first.attribute("warnings").unwrap_or_default().lines() {
            match found.iter_mut().find(|(warning, _)| warning == line) {
                Some((_, stages)) => stages.push(&stage.stage),
                None => found.push((line.to_owned(), vec![&stage.stage])),
            }
        }
    }
    let told = |(warning, stages): (String, Vec<&str>)| format!("{}: {warning}", stages.join(", "));
    Ok(found.into_iter().map(told).collect())
}
