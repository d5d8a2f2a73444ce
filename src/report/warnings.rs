//! What the artifacts of a run warn of: samples that fail.

use super::artifacts::RunArtifacts;
use super::error::ReportError;
use crate::content::Solutions;

/// The warnings of all stages that simulate, after the name of the stage. Estimates and verified designs say nothing of breakdown.
///
/// # Errors
/// When an artifact cannot be read.
pub fn warnings(run: &RunArtifacts<'_>) -> Result<Vec<String>, ReportError> {
    let warning = run.each("solve", |source| {
        let view = source.of(Solutions::open(source.artifact))?;
        let ratios = source
            .of(view.observations().breakdown_ratio().read())?
            .unwrap_or_default();
        let (n, beyond) = (ratios.len(), ratios.iter().filter(|ratio| **ratio >= 1.0).count());
        let stage = &source.stage.stage;
        Ok((beyond > 0).then(|| format!("{stage}: {beyond} of {n} samples exceed the breakdown field")))
    })?;
    Ok(warning.into_iter().flatten().collect())
}
