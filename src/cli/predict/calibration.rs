//! Finds the calibration of a model: the one that is named, or that of the last run which calibrated the model.

use std::path::Path;

use crate::{CliError, locate, model as models};
use deaflow_content::{ArtifactKind, Calibration};
use deaflow_stage::calibrate::{self, CalibratedModel};
use deaflow_store::Artifact;

/// A calibration and its source.
pub struct NamedCalibration {
    /// Its name.
    pub name: String,
    /// The digest of its artifact.
    pub digest: String,
    /// The calibration.
    pub calibrated: CalibratedModel,
}

/// Finds the calibration of a model, which has a name and the digest of its file; none if none is named and no run has
/// made one.
///
/// # Errors
/// When the named artifact is not a calibration of this model, or is damaged.
pub fn find(
    (model, weights): (&str, &str),
    calibration: Option<&str>,
    store: &Path,
) -> Result<Option<NamedCalibration>, CliError> {
    let found = match calibration {
        Some(name) => {
            let artifact = models::of_kind(name, store, ArtifactKind::Calibrate, "calibration")?;
            Some((name.to_owned(), artifact))
        }
        // The store of this folder may belong to another project than the file.
        None if models::is_file(model) => None,
        None => of_runs(store, weights)?,
    };
    let Some((name, artifact)) = found else {
        return Ok(None);
    };
    let digest = artifact.digest();
    let read = calibrate::read(&artifact).map_err(|e| CliError::failure(e.to_string()))?;
    match read {
        Some(calibrated) if calibrated.weights == weights => Ok(Some(NamedCalibration {
            name,
            digest: digest.to_string(),
            calibrated,
        })),
        Some(other) => Err(CliError::bad_input(format!(
            "calibration {} belongs to the model {:.12}, not to {}",
            digest.short(),
            other.model,
            model
        ))
        .help(
            "calibrate this model: add a stage of kind `calibrate` that needs it and patterns it was not trained on",
        )),
        None => Err(CliError::bad_input(format!(
            "artifact {} is not a calibration",
            digest.short()
        ))),
    }
}

/// The calibration of the newest run that calibrated the model; of several, the one from the most patterns.
fn of_runs(store: &Path, weights: &str) -> Result<Option<(String, Artifact)>, CliError> {
    let store = locate::existing_store(store)?;
    for run in store.runs()? {
        let mut found: Vec<(u64, String, Artifact)> = Vec::new();
        for stage in run?
            .stages
            .iter()
            .filter(|stage| stage.kind == ArtifactKind::Calibrate.name())
        {
            // Artifacts of old runs may have been removed since.
            if store.find(&stage.artifact.to_string())?.is_empty() {
                continue;
            }
            let artifact = store.artifact(&stage.artifact)?;
            if artifact.attributes().get("weights").is_some_and(|own| own == weights) {
                let samples = Calibration::open(&artifact)?.samples().read()?;
                found.push((samples.iter().sum(), stage.name.clone(), artifact));
            }
        }
        if let Some((_, name, artifact)) = found.into_iter().max_by_key(|(samples, ..)| *samples) {
            return Ok(Some((name, artifact)));
        }
    }
    Ok(None)
}
