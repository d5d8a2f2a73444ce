//! Warnings about what effects observed in simulated samples: dielectric breakdown, and critical voltages.

use super::artifacts::{ArtifactReader, RunArtifacts, StageArtifact};
use super::error::ReportError;
use deaflow_content::{Solutions, SolutionsView};
use deaflow_scene::Breakdown;
use deaflow_scene::effects::names::{BREAKDOWN, STABILITY};

/// Warns of samples beyond the breakdown field, or else of those close to it, and of samples that a finer mesh could
/// reject. Only the stages in `observing` are opened; estimates and verified designs have no observations.
///
/// # Errors
/// If an artifact cannot be read.
pub fn observed_warnings(run: &RunArtifacts<'_>, observing: &[String]) -> Result<Vec<String>, ReportError> {
    let named: Vec<StageArtifact> = run
        .stages
        .iter()
        .filter(|made| observing.contains(&made.stage))
        .cloned()
        .collect();
    let run = RunArtifacts { stages: &named, ..*run };
    let warnings = run.each("solve", |source| {
        // If the effects are off, only the first chunk is opened.
        let effects = source.of(Solutions::unchecked(source.artifact).effects().text())?;
        let is_on = |effect: &str| effects.as_ref().is_some_and(|effects| effects.contains(effect));
        let (breakdown, stability) = (is_on(BREAKDOWN), is_on(STABILITY));
        if !breakdown && !stability {
            return Ok(Vec::new());
        }
        let view = source.of(Solutions::open(source.artifact))?;
        let breakdown = breakdown.then(|| of_breakdown(source, &view)).transpose()?;
        let stability = stability.then(|| of_stability(source, &view)).transpose()?;
        Ok([breakdown, stability].into_iter().flatten().flatten().collect())
    })?;
    Ok(warnings.into_iter().flatten().collect())
}

fn of_breakdown(source: &ArtifactReader<'_>, view: &SolutionsView<'_>) -> Result<Option<String>, ReportError> {
    let ratios = view.observations().breakdown_ratio().read();
    let ratios = source.of(ratios)?.unwrap_or_default();
    let (n, stage) = (ratios.len(), &source.stage.stage);
    let from = |least: f64| ratios.iter().filter(|ratio| **ratio >= least).count();
    Ok(match (from(1.0), from(Breakdown::NEAR)) {
        (0, 0) => None,
        (0, near) => Some(format!(
            "{stage}: {near} of {n} samples are close to the breakdown field: E/E_B is {} or more",
            Breakdown::NEAR
        )),
        (beyond, _) => Some(format!("{stage}: {beyond} of {n} samples exceed the breakdown field")),
    })
}

fn of_stability(source: &ArtifactReader<'_>, view: &SolutionsView<'_>) -> Result<Option<String>, ReportError> {
    let near = source.of(view.near_limit())?;
    let (n, stage) = (near.len(), &source.stage.stage);
    let near = near.into_iter().filter(|near| *near).count();
    Ok((near > 0).then(|| {
        format!(
            "{stage}: {near} of {n} samples converged near the limit: a finer mesh could reject them, as their \
             critical voltage on this one is hardly above that of the scene; set `accuracy`"
        )
    }))
}
