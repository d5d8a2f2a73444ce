//! Finds the calibration of a model: the one that is named, or the one that the last run which has one made.

use std::path::Path;

use super::PredictArguments;
use crate::error::CliError;
use crate::{locate, model};
use deaflow_base::Digest;
use deaflow_content::Calibration;
use deaflow_stage::calibrate::{self, CalibratedModel};
use deaflow_store::Artifact;

/// A calibration with where it comes from.
pub struct NamedCalibration {
    /// What it is called.
    pub name: String,
    /// The digest of its artifact.
    pub digest: String,
    /// Itself.
    pub of: CalibratedModel,
}

/// The calibration of a model given as the bytes of its file; none where none is named and no run in the store has one.
///
/// # Errors
/// When the one that is named is none, is of another model, or is damaged.
pub fn find(arguments: &PredictArguments, weights: &[u8]) -> Result<Option<NamedCalibration>, CliError> {
    let (store, weights) = (arguments.store_folder(), Digest::of(weights).to_string());
    let found = match &arguments.calibration {
        Some(name) => {
            let artifact = model::of_kind(name, &store, "calibrate", "calibration")?;
            Some((name.clone(), artifact))
        }
        // A file stands for itself: what the store of this folder has may be of another project.
        None if model::is_file(&arguments.model) => None,
        None => of_runs(&store, &weights)?,
    };
    let Some((name, artifact)) = found else {
        return Ok(None);
    };
    let digest = artifact.digest();
    let read = calibrate::read(&artifact).map_err(|e| CliError::failure(e.to_string()));
    match read? {
        Some(of) if of.weights == weights => Ok(Some(NamedCalibration {
            name,
            digest: digest.to_string(),
            of,
        })),
        Some(of) => Err(CliError::bad_input(format!(
            "the calibration {} is of the model {:.12}, and not of {}",
            digest.short(),
            of.model,
            arguments.model
        ))
        .help("make one of this model: a stage of kind `calibrate` that needs it and patterns it never saw")),
        None => Err(CliError::bad_input(format!(
            "artifact {} is no calibration",
            digest.short()
        ))),
    }
}

/// What the newest run that calibrated the model made; of several calibrations the one of the most patterns.
fn of_runs(store: &Path, weights: &str) -> Result<Option<(String, Artifact)>, CliError> {
    let store = locate::existing_store(store)?;
    for run in store.runs()? {
        let mut found: Vec<(u64, String, Artifact)> = Vec::new();
        for stage in run?.stages.iter().filter(|stage| stage.kind == "calibrate") {
            // What old runs made may have been removed since.
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
