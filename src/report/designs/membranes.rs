//! Drawings of the membranes of designs.

use super::objective::Objective;
use crate::artifacts::ArtifactReader;
use crate::drawing::{Background, DeformedMembrane};
use crate::error::ReportError;
use deaflow_content::{DesignRowsView, StoredAttribute};
use deaflow_field::Field;
use deaflow_scene::Scene;

/// Returns the patterns of some rows of a design or verify artifact with their fields.
pub(crate) fn membranes<'f>(
    source: &ArtifactReader<'_>,
    rows: &DesignRowsView<'_>,
    scene: &StoredAttribute<'_, Scene>,
    selected: impl Iterator<Item = (usize, &'f Field)>,
) -> Result<Vec<DeformedMembrane>, ReportError> {
    let (patterns, objectives) = (source.of(rows.patterns().read())?, source.of(rows.objective().read())?);
    let scene = source.of(scene.read())?;
    let background = Background::of(&scene);
    // Single fields belong to the first state.
    let state = scene.states.iter().next().map(|(name, _)| name.to_owned());
    let membrane = |(row, field): (usize, &Field)| {
        let objective = Objective::read(&objectives.0[row], &scene).map_err(|e| source.wrong(e.to_string()))?;
        let points = objective.targets.iter().filter(|target| target.has_point());
        let points = points.map(|target| target.point).collect();
        let drawn = DeformedMembrane::new(patterns[row].cells(), field.values(), background.clone(), points);
        Ok(source.drawn(drawn)?.in_state(state.clone()))
    };
    selected.map(membrane).collect()
}
