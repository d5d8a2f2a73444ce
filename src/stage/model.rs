//! Trained networks as stages and commands use them: read from an artifact or a file, and held to the scene they serve in.

use super::direct::DirectError;
use crate::content::Training;
use crate::orchestrator::StageError;
use crate::scene::Scene;
use crate::store::Artifact;
use crate::surrogate::Surrogate;

/// Whether an artifact holds a model.
#[must_use]
pub fn is_in(artifact: &Artifact) -> bool {
    artifact.kind() == "train"
}

/// The bytes of the model of a train stage.
///
/// # Errors
/// When the artifact holds none.
pub fn weights(artifact: &Artifact) -> Result<Vec<u8>, StageError> {
    Ok(Training::unchecked(artifact).weights().read()?)
}

/// The network of a train stage.
///
/// # Errors
/// When the artifact holds no model of this program.
pub fn of_artifact(artifact: &Artifact) -> Result<Surrogate, StageError> {
    Surrogate::load(&weights(artifact)?)
        .map_err(|e| StageError::Input(format!("artifact {}: {e}", artifact.digest().short())))
}

/// The network of a train stage, for use in a scene.
///
/// # Errors
/// As [`of_artifact`], or when it was trained in another scene.
pub fn in_scene(artifact: &Artifact, scene: &Scene) -> Result<Surrogate, StageError> {
    let surrogate = of_artifact(artifact)?;
    check_scene(&surrogate, scene)
        .map_err(|why| StageError::Input(format!("artifact {}: {why}", artifact.digest().short())))?;
    Ok(surrogate)
}

/// Refuses a model for another scene than the one it is to be used in.
///
/// # Errors
/// When it was trained in another, with every key that differs; or does not say in which.
pub fn check_scene(surrogate: &Surrogate, scene: &Scene) -> Result<(), String> {
    let text = surrogate
        .scene()
        .ok_or_else(|| "the model does not say which scene it was trained in".to_owned())?;
    let trained = Scene::from_text(text).map_err(|e| format!("the scene of the model cannot be read: {e}"))?;
    same_scene("the model was trained in", &trained, scene)
}

/// Refuses what was made in another scene. `made` says what and how: "the model was trained in".
///
/// # Errors
/// With every key that differs and both values.
pub fn same_scene(made: &str, there: &Scene, here: &Scene) -> Result<(), String> {
    match listed(there, here) {
        Some(list) => Err(format!("{made} another scene: {list}")),
        None => Ok(()),
    }
}

/// Every key that differs between two scenes, with both values; nothing where they are simulated alike.
pub fn listed(there: &Scene, here: &Scene) -> Option<String> {
    let differences = there.differences(here);
    let list: Vec<String> = differences.iter().map(ToString::to_string).collect();
    (!list.is_empty()).then(|| list.join("; "))
}

/// A model that is to be written as a file.
pub struct Exportable(Surrogate);

impl Exportable {
    /// From the bytes of a safetensors file.
    ///
    /// # Errors
    /// When they are no model.
    pub fn new(weights: &[u8]) -> Result<Self, DirectError> {
        Surrogate::load(weights)
            .map(Self)
            .map_err(|e| DirectError::Model(e.to_string()))
    }

    /// The name of the network.
    #[must_use]
    pub fn network(&self) -> &'static str {
        self.0.kind().name()
    }

    /// What the file says about it, as JSON.
    ///
    /// # Errors
    /// When it cannot be written as text.
    pub fn header(&self) -> Result<String, DirectError> {
        Ok(self.0.header()?)
    }

    /// The bytes of an ONNX file.
    ///
    /// # Errors
    /// When the tensors cannot be read.
    pub fn onnx(&self) -> Result<Vec<u8>, DirectError> {
        Ok(self.0.to_onnx()?)
    }
}
