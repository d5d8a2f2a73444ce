//! Compares the scene and the effects that a dataset declares with those of the audit.

use super::source::Source;
use deaflow_dataset::audit::{Finding, Severity};
use deaflow_fem::SetupError;
use deaflow_fem::screening::resolve;
use deaflow_scene::{Effects, Scene};

/// Returns a finding if a file declares another scene. Properties of the material do not count: they change no label.
pub fn other_scene(source: &Source, scene: &Scene) -> Result<Option<Finding>, SetupError> {
    let Some(declared) = source.scene.as_deref() else {
        return Ok(None);
    };
    let declared = match Scene::from_text(declared) {
        Ok(declared) => declared,
        Err(error) => {
            let message = format!("the scene that the file says it was made with cannot be read: {error}");
            return Ok(Some(Finding::whole("provenance", Severity::Error, message)));
        }
    };
    // With `effects: auto` the file declares its effects in an attribute of their own.
    let effects = !declared.auto && declared.effects != resolve(scene)?.effects;
    let parts = [
        ("geometry", declared.geometry != scene.geometry),
        ("material", declared.material != scene.material),
        ("drive", declared.drive.voltages != scene.drive.voltages),
        ("effects", effects),
    ];
    let differing = parts.iter().filter(|(_, differs)| *differs).map(|(name, _)| *name);
    let differing: Vec<&str> = differing.collect();
    let message = format!(
        "the file says that it was made with another scene: {} differ",
        differing.join(", ")
    );
    Ok((!differing.is_empty()).then(|| Finding::whole("provenance", Severity::Error, message)))
}

/// Returns a finding if a dataset declares other effects than those of the scene.
pub fn other_effects(source: &Source, scene: &Scene) -> Result<Option<Finding>, SetupError> {
    let Some(declared) = source.effects.as_deref() else {
        return Ok(None);
    };
    let of_scene = resolve(scene)?.effects;
    let message = match Effects::from_text(declared) {
        Ok(declared) if declared == of_scene => return Ok(None),
        Ok(declared) => format!(
            "the dataset says that it was simulated with the effects {}, and those of the scene are {}",
            declared.to_text(),
            of_scene.to_text()
        ),
        Err(error) => format!("the effects that the dataset says it was simulated with cannot be read: {error}"),
    };
    Ok(Some(Finding::whole("provenance", Severity::Error, message)))
}
