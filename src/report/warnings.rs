//! What the artifacts of a run warn of: samples that fail.

use super::artifacts::{Made, RunArtifacts};
use super::error::ReportError;
use deaflow_content::Solutions;

/// The effect under which simulated samples carry a ratio to breakdown.
const BREAKDOWN: &str = "dielectric_breakdown";

/// The warnings of stages that simulate, after the name of the stage; only those are opened whose scene may have the effect. Estimates
/// and verified designs say nothing of breakdown.
///
/// # Errors
/// When an artifact cannot be read.
pub fn warnings(run: &RunArtifacts<'_>, may_break_down: &[String]) -> Result<Vec<String>, ReportError> {
    let named: Vec<Made> = run
        .made
        .iter()
        .filter(|made| may_break_down.contains(&made.stage))
        .cloned()
        .collect();
    let run = RunArtifacts { made: &named, ..*run };
    let warning = run.each("solve", |source| {
        // Where the effect is off no chunk but the first is opened.
        let effects = source.of(Solutions::unchecked(source.artifact).effects().text())?;
        if !effects.is_some_and(|effects| effects.contains(BREAKDOWN)) {
            return Ok(None);
        }
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
