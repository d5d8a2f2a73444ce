//! Whether a network may be used in a scene: it knows no other than the one that it was trained in.

use super::predict::Surrogate;
use deaflow_base::InputError;
use deaflow_scene::{Difference, Scene};

/// Why a network may not be used in a scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// Its file does not say where it was trained.
    #[error("the model does not say which scene it was trained in")]
    Unknown,
    /// What its file says is no scene.
    #[error("the scene of the model cannot be read: {0}")]
    Unreadable(InputError),
    /// It was trained in another.
    #[error("the model was trained in another scene: {}", Difference::listed(.0))]
    Another(Vec<Difference>),
}

impl Surrogate {
    /// Refuses a model for another scene than the one it is to be used in.
    ///
    /// # Errors
    /// When it was trained in another, with every key that differs; or does not say in which.
    pub fn check_scene(&self, scene: &Scene) -> Result<(), SceneError> {
        let text = self.scene().ok_or(SceneError::Unknown)?;
        let trained = Scene::from_text(text).map_err(SceneError::Unreadable)?;
        let differences = trained.differences(scene);
        match differences.is_empty() {
            true => Ok(()),
            false => Err(SceneError::Another(differences)),
        }
    }
}
