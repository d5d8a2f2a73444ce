//! What the artifacts of a run warn of: samples that fail.

use super::gather::{Made, ReportError, Source};
use crate::store::Store;

/// The effect under which simulated samples carry a ratio, and its dataset.
const BREAKDOWN: &str = "dielectric_breakdown";
const RATIO: &str = "breakdown_ratio";

/// The warnings of all stages that simulate, after the name of the stage.
///
/// # Errors
/// When an artifact cannot be read.
pub fn warnings(store: &Store, made: &[Made]) -> Result<Vec<String>, ReportError> {
    let mut broken = Vec::new();
    for stage in made
        .iter()
        .filter(|stage| ["solve", "verify"].contains(&stage.kind.as_str()))
    {
        let artifact = store.artifact(&stage.digest)?;
        let part = artifact.parts().first().map(|part| store.artifact(part)).transpose()?;
        // All chunks of a stage are simulated alike.
        let first = part.as_ref().unwrap_or(&artifact);
        let effect = first.attribute("effects").unwrap_or_default().contains(BREAKDOWN);
        // Estimates and verified designs say nothing of it.
        if effect && artifact.contents()?.iter().any(|content| content.path == RATIO) {
            let source = Source {
                stage,
                artifact: &artifact,
                run: made,
            };
            let ratios = source.reals(RATIO)?;
            let (n, beyond) = (ratios.len(), ratios.iter().filter(|ratio| **ratio >= 1.0).count());
            if beyond > 0 {
                broken.push(format!(
                    "{}: {beyond} of {n} samples exceed the breakdown field",
                    stage.stage
                ));
            }
        }
    }
    Ok(broken)
}
