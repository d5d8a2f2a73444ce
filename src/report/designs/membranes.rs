//! The membranes of designs, for figures.

use super::Objective;
use crate::artifacts::Source;
use crate::drawing::{Ground, Membrane};
use crate::error::ReportError;
use deaflow_content::{DesignRowsView, StoredAttribute};
use deaflow_field::Field;
use deaflow_scene::Scene;

/// The patterns of some rows of a design or its verification, each with a field.
pub(crate) fn membranes<'f>(
    source: &Source<'_>,
    rows: &DesignRowsView<'_>,
    scene: &StoredAttribute<'_, Scene>,
    wanted: impl Iterator<Item = (usize, &'f Field)>,
) -> Result<Vec<Membrane>, ReportError> {
    let (patterns, objectives) = (source.of(rows.patterns().read())?, source.of(rows.objective().read())?);
    let scene = source.of(scene.read())?;
    let ground = Ground::of(&scene);
    // Fields that stand alone are those of the first state.
    let state = scene.states.iter().next().map(|(name, _)| name.to_owned());
    let membrane = |(row, field): (usize, &Field)| {
        let objective = Objective::read(&objectives.0[row], &scene).map_err(|e| source.wrong(e.to_string()))?;
        let points = objective.aims.iter().map(|aim| aim.point).collect();
        let drawn = Membrane::new(patterns[row].cells(), field.values(), ground.clone(), points);
        Ok(source.drawn(drawn)?.in_state(state.clone()))
    };
    wanted.map(membrane).collect()
}
