//! The key `scene: { from: STAGE }`: the scene of a stage is one that another stage makes, such as a fit.
//!
//! Such a stage waits for the other, and its parameters are those with the scene that was made. So it is built again
//! if that scene changes, not if anything else in the artifact does.

use std::sync::{Arc, Mutex, PoisonError};

use super::kind::{Kind, Stage, StageError};
use deaflow_base::{ArtifactId, Fields, InputError, Node, Schema};
use deaflow_store::{Artifact, StoreError};

/// The key of a stage with the stage that makes its scene.
pub const SCENE: &str = "scene";

/// The key in it with the name of that stage.
pub const FROM: &str = "from";

/// Adds the key of stages that read a scene.
pub fn schema(fields: Fields) -> Fields {
    let scene = Fields::new("A scene that another stage makes, such as a fit, in place of that of the pipeline.");
    let scene = Schema::from(scene.required(FROM, Schema::text().description("The stage that makes the scene.")));
    fields.optional(SCENE, scene)
}

/// Returns the name of the stage that makes the scene of a stage, if there is one.
///
/// # Errors
/// If the key is not a mapping with `from` only.
pub fn named(stage: &Node) -> Result<Option<&Node>, InputError> {
    let Some(scene) = stage.peek(SCENE) else {
        return Ok(None);
    };
    let from = scene.fields("the scene of a stage", &[FROM])?;
    Ok(Some(from.required("the scene of a stage", FROM)?))
}

/// A stage whose scene another stage makes.
pub struct SceneFrom {
    /// The index of the other stage in the pipeline.
    pub index: usize,
    /// The mapping of the stage without the key.
    node: Node,
    /// The stage with the scene of an artifact, or why it cannot be read.
    read: Mutex<Option<ReadStage>>,
}

#[derive(Clone)]
struct ReadStage {
    /// The artifact that has the scene.
    artifact: ArtifactId,
    scene: Option<Arc<Node>>,
    stage: Result<Arc<dyn Stage>, Arc<InputError>>,
}

impl SceneFrom {
    /// Creates it before the scene is known.
    pub fn new(index: usize, node: Node) -> Self {
        Self {
            index,
            node,
            read: Mutex::default(),
        }
    }

    /// Reads the stage with the scene of an artifact, which `maker` has made. An artifact that cannot be opened, such
    /// as a damaged one, may be repaired later, so it is tried again each time.
    pub fn read(
        &self,
        kind: &dyn Kind,
        maker: &dyn Kind,
        artifact: &ArtifactId,
        open: &dyn Fn() -> Result<Artifact, StoreError>,
    ) {
        let is_read = |read: &ReadStage| read.artifact == *artifact && read.scene.is_some();
        if self.current().as_ref().is_some_and(is_read) {
            return;
        }
        let scene = open()
            .map_err(StageError::from)
            .and_then(|artifact| maker.scene_of(&artifact));
        let stage = match &scene {
            Ok(scene) => kind.read(&self.node, Some(scene)).map(Arc::from).map_err(Arc::new),
            Err(error) => Err(Arc::new(self.node.error(error.to_string()))),
        };
        let read = ReadStage {
            artifact: *artifact,
            scene: scene.ok().map(Arc::new),
            stage,
        };
        *self.read.lock().unwrap_or_else(PoisonError::into_inner) = Some(read);
    }

    /// Forgets the scene: its artifact is not known or not there.
    pub fn forget(&self) {
        *self.read.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    fn current(&self) -> Option<ReadStage> {
        self.read.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Returns the stage with its scene, if that is known and valid.
    pub fn stage(&self) -> Option<Arc<dyn Stage>> {
        self.current()?.stage.ok()
    }

    /// Returns the scene, if it is known.
    pub fn scene(&self) -> Option<Node> {
        Some(self.current()?.scene?.as_ref().clone())
    }

    /// Returns why the stage cannot have the scene, if so.
    pub fn refusal(&self) -> Option<StageError> {
        let error = self.current()?.stage.err()?;
        Some(StageError::input(format!("the stage cannot have its scene: {error}")))
    }
}
