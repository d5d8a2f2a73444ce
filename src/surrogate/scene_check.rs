//! Checks that a surrogate was trained in the scene in which it is used.

use super::predict::Surrogate;
use deaflow_base::InputError;
use deaflow_scene::{Difference, Scene};

/// Why a surrogate cannot be used in a scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The model file has no training scene.
    #[error("the model does not name its training scene")]
    Unknown,
    /// The training scene in the model file is invalid.
    #[error("cannot read the training scene of the model: {0}")]
    Unreadable(InputError),
    /// The training scene differs.
    #[error("the model was trained in a different scene: {}", Difference::listed(.0))]
    Different(Vec<Difference>),
}

impl Surrogate {
    /// Checks that the training scene equals `scene`.
    ///
    /// # Errors
    /// When the scenes differ, with every key that differs; when the training scene is missing or invalid.
    pub fn check_scene(&self, scene: &Scene) -> Result<(), SceneError> {
        let text = self.scene().ok_or(SceneError::Unknown)?;
        let trained = Scene::from_text(text).map_err(SceneError::Unreadable)?;
        let differences = trained.differences(scene);
        match differences.is_empty() {
            true => Ok(()),
            false => Err(SceneError::Different(differences)),
        }
    }
}
