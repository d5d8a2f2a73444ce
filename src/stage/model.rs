//! Reads trained networks from artifacts and checks that they fit a scene.

use std::collections::BTreeSet;

use deaflow_content::{ALL_FAMILIES, ArtifactKind, Training};
use deaflow_dataset::Split;
use deaflow_orchestrator::StageError;
use deaflow_scene::Scene;
use deaflow_store::Artifact;
use deaflow_surrogate::Surrogate;

/// Whether an artifact has a model.
pub fn is_in(artifact: &Artifact) -> bool {
    ArtifactKind::Train.is_of(artifact)
}

/// Returns the bytes of the model of a train stage.
///
/// # Errors
/// If the artifact has no model.
pub fn weights(artifact: &Artifact) -> Result<Vec<u8>, StageError> {
    Ok(Training::unchecked(artifact).weights().read()?)
}

/// Loads the network of a train stage.
///
/// # Errors
/// If the artifact has no valid model.
pub fn of_artifact(artifact: &Artifact) -> Result<Surrogate, StageError> {
    Surrogate::load(&weights(artifact)?).map_err(|e| StageError::in_artifact(artifact, e))
}

/// Loads the network of a train stage for use in a scene.
///
/// # Errors
/// As [`of_artifact`], or if it was trained in another scene.
pub fn in_scene(artifact: &Artifact, scene: &Scene) -> Result<Surrogate, StageError> {
    let surrogate = of_artifact(artifact)?;
    surrogate
        .check_scene(scene)
        .map_err(|why| StageError::in_artifact(artifact, why))?;
    Ok(surrogate)
}

/// Loads the networks of train stages for the states of a scene, in the order of the states; each must have been
/// trained at the drive of its state. For a scene without states it is the only network.
///
/// # Errors
/// As [`in_scene`], or if a state has no network, or a network no state.
pub fn in_states(artifacts: &[&Artifact], scene: &Scene) -> Result<Vec<Surrogate>, StageError> {
    if let ([only], true) = (artifacts, scene.states.is_empty()) {
        return in_scene(only, scene).map(|network| vec![network]);
    }
    let mut left = Vec::new();
    for artifact in artifacts {
        left.push((artifact.digest().short().to_string(), of_artifact(artifact)?));
    }
    let mut found = Vec::new();
    for (name, scene) in scene.in_states() {
        let fitting = left.iter().position(|(_, network)| network.check_scene(&scene).is_ok());
        let Some(fitting) = fitting else {
            let why = left.first().and_then(|(_, network)| network.check_scene(&scene).err());
            let why = why.map_or(String::new(), |why| format!("; {why}"));
            return Err(StageError::input(format!(
                "`needs` has no model trained in state `{name}`; a design evaluated by networks needs one for each \
                 state{why}"
            )));
        };
        found.push(left.swap_remove(fitting).1);
    }
    match left.first() {
        None => Ok(found),
        Some((digest, _)) => Err(StageError::input(format!("artifact {digest}: more models than states"))),
    }
}

/// Returns the families that a model was trained on.
///
/// # Errors
/// If the artifact cannot be read.
pub fn families(model: &Artifact) -> Result<BTreeSet<String>, StageError> {
    let metrics = Training::open(model)?.metrics();
    let pairs = metrics.family().read()?.into_iter().zip(metrics.split().read()?);
    let trained = pairs.filter(|(family, split)| split == Split::Train.name() && family != ALL_FAMILIES);
    Ok(trained.map(|(family, _)| family).collect())
}
