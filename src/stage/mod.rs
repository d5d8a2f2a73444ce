//! One file per stage kind: binds a domain function to the orchestrator, no more.

pub mod accuracy;
mod arrays;
pub mod audit;
mod balance;
mod calibrate;
mod cells;
mod design;
pub mod designs;
pub mod direct;
mod evaluate;
mod labelled;
pub mod mask;
pub mod membrane;
pub mod model;
pub mod path;
mod sample;
pub mod screening;
mod solution;
mod solve;
mod train;
mod verify;

use crate::base::{InputError, Node, Schema};
use crate::content::ContentError;
use crate::fem::effects::Model;
use crate::orchestrator::{Registry, StageError};
use crate::scene::Scene;
use crate::store::Artifact;

/// All kinds of stages, and how a scene is checked.
#[must_use]
pub fn registry() -> Registry {
    Registry {
        kinds: vec![
            &sample::SampleKind,
            &solve::SolveKind,
            &balance::BalanceKind,
            &train::TrainKind,
            &design::DesignKind,
            &verify::VerifyKind,
            &accuracy::AccuracyKind,
            &audit::AuditKind,
            &calibrate::CalibrateKind,
            &evaluate::EvaluateKind,
        ],
        check_scene: |node| checked_scene(node).map(|_| ()),
        scene_schema: Scene::schema,
    }
}

/// What a `seed` may be.
fn seed() -> Schema {
    Schema::whole(0, i64::MAX as u64).says("Names the random numbers.")
}

/// The scene of the pipeline, for a stage that cannot do without.
fn scene_of(stage: &Node, scene: Option<&Node>) -> Result<Scene, InputError> {
    let missing = || {
        stage
            .error("this stage needs a scene, and the pipeline has none")
            .help("add `scene: FILE` or an inline mapping")
    };
    checked_scene(scene.ok_or_else(missing)?)
}

/// A scene that can be simulated, or where it cannot. What `effects: auto` would turn on is checked as far as that is known
/// without a solution.
fn checked_scene(node: &Node) -> Result<Scene, InputError> {
    let scene = Scene::read(node)?;
    let mut effects = scene.effects.clone();
    if scene.auto {
        effects.strain_stiffening = scene.properties.strain_stiffening.clone();
    }
    match Model::new(&scene.with_effects(effects)) {
        Ok(_) => Ok(scene),
        Err(error) => {
            let section = if scene.auto { "properties" } else { "effects" };
            Err(node.peek(section).unwrap_or(node).error(error.to_string()))
        }
    }
}

impl From<ContentError> for StageError {
    fn from(error: ContentError) -> Self {
        match error {
            ContentError::Store(error) => Self::Store(error),
            fault => Self::Input(fault.to_string()),
        }
    }
}

/// The scene that all inputs were made with, as text; inputs of different scenes do not belong in one model.
fn scene_attribute(inputs: &[Artifact]) -> Result<String, StageError> {
    let mut found: Option<&str> = None;
    for input in inputs {
        let scene = input.attribute("scene").ok_or_else(|| {
            StageError::Input(format!(
                "artifact {} does not say which scene it was made with",
                input.digest().short()
            ))
        })?;
        if let Some(other) = found.filter(|other| *other != scene) {
            return Err(differ(other, scene));
        }
        found = Some(scene);
    }
    found
        .map(str::to_owned)
        .ok_or_else(|| StageError::Input("the stage has no inputs".to_owned()))
}

/// What is said of inputs of different scenes.
fn differ(one: &str, other: &str) -> StageError {
    let scenes = Scene::from_text(one).ok().zip(Scene::from_text(other).ok());
    let list = scenes.and_then(|(one, other)| model::listed(&one, &other));
    let list = list.map_or(String::new(), |list| format!(": {list}"));
    StageError::Input(format!("the inputs were made with different scenes{list}"))
}
