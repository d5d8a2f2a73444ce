//! The calibrations among the inputs of an evaluation.

use super::predictors::NamedPredictor;
use crate::calibrate::{self, CalibratedModel};
use deaflow_orchestrator::StageError;
use deaflow_store::Artifact;

/// A calibration of one of the predictors.
pub struct Calibrated {
    /// Digest of its artifact.
    pub digest: String,
    /// Its content.
    pub model: CalibratedModel,
    /// Index of the predictor that it calibrates.
    pub predictor: usize,
}

/// Reads the calibrations among the inputs.
///
/// # Errors
/// If one cannot be read, or its model is not among the predictors.
pub fn calibrations(inputs: &[Artifact], predictors: &[NamedPredictor]) -> Result<Vec<Calibrated>, StageError> {
    let mut found = Vec::new();
    for input in inputs {
        let Some(model) = calibrate::read(input)? else {
            continue;
        };
        let mut digests = predictors.iter().map(NamedPredictor::digest);
        let predictor = digests.position(|digest| digest == model.model).ok_or_else(|| {
            StageError::input(format!(
                "calibration {} belongs to model {:.12}, which is not among the models of this stage",
                input.digest().short(),
                model.model
            ))
        })?;
        found.push(Calibrated {
            digest: input.digest().to_string(),
            model,
            predictor,
        });
    }
    Ok(found)
}
