//! Warnings about dielectric breakdown of simulated samples.

use super::artifacts::{RunArtifacts, StageArtifact};
use super::error::ReportError;
use deaflow_content::Solutions;

/// The effect with which samples have a breakdown ratio.
const BREAKDOWN: &str = "dielectric_breakdown";

/// From this share of the breakdown field on, samples are close to it; screening has the same threshold.
const NEAR: f64 = 0.8;

/// Warns of samples beyond the breakdown field, or else of those close to it. Only the stages in `may_break_down` are opened; estimates and verified
/// designs have no breakdown ratio.
///
/// # Errors
/// If an artifact cannot be read.
pub fn breakdown_warnings(run: &RunArtifacts<'_>, may_break_down: &[String]) -> Result<Vec<String>, ReportError> {
    let named: Vec<StageArtifact> = run
        .stages
        .iter()
        .filter(|made| may_break_down.contains(&made.stage))
        .cloned()
        .collect();
    let run = RunArtifacts { stages: &named, ..*run };
    let warning = run.each("solve", |source| {
        // If the effect is off, only the first chunk is opened.
        let effects = source.of(Solutions::unchecked(source.artifact).effects().text())?;
        if !effects.is_some_and(|effects| effects.contains(BREAKDOWN)) {
            return Ok(None);
        }
        let view = source.of(Solutions::open(source.artifact))?;
        let ratios = source
            .of(view.observations().breakdown_ratio().read())?
            .unwrap_or_default();
        let (n, stage) = (ratios.len(), &source.stage.stage);
        let from = |least: f64| ratios.iter().filter(|ratio| **ratio >= least).count();
        Ok(match (from(1.0), from(NEAR)) {
            (0, 0) => None,
            (0, near) => Some(format!(
                "{stage}: {near} of {n} samples are close to the breakdown field: E/E_B is {NEAR} or more"
            )),
            (beyond, _) => Some(format!("{stage}: {beyond} of {n} samples exceed the breakdown field")),
        })
    })?;
    Ok(warning.into_iter().flatten().collect())
}
