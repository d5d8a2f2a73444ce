//! One file per stage kind: binds a domain function to the orchestrator, no more.

pub mod accuracy;
pub mod audit;
mod balance;
pub mod calibrate;
mod design;
pub mod designs;
pub mod direct;
mod evaluate;
mod files;
mod foresight;
mod import;
mod labelled;
mod model;
mod needs;
mod patterns;
mod results;
mod sample;
pub mod solution;
mod solve;
mod table;
mod train;
mod verify;

pub use foresight::of_faint_drive;
pub use results::{unit as result_unit, words_of as result_words};

use deaflow_base::{Fields, InputError, Node, Schema};
use deaflow_content::StoredAttribute;
use deaflow_dataset::Device;
use deaflow_fem::effects::Model;
use deaflow_orchestrator::{MOST_STAGES, Registry, StageError};
use deaflow_pattern::Raster;
use deaflow_scene::{Difference, Outline, Scene, States};
use deaflow_store::Artifact;

/// All kinds of stages, and how a scene is checked.
#[must_use]
pub fn registry() -> Registry {
    Registry {
        kinds: vec![
            &sample::SampleKind,
            &patterns::PatternsKind,
            &solve::SolveKind,
            &import::ImportKind,
            &balance::BalanceKind,
            &train::TrainKind,
            &design::DesignKind,
            &verify::VerifyKind,
            &accuracy::AccuracyKind,
            &audit::AuditKind,
            &calibrate::CalibrateKind,
            &evaluate::EvaluateKind,
            &table::TableKind,
        ],
        check_scene: |node| checked_scene(node).map(|_| ()),
        scene_schema: Scene::schema,
        most_stages: MOST_STAGES,
    }
}

/// The scene of the pipeline, for a stage that cannot do without and knows all states of a device.
fn scene_in_states_of(stage: &Node, scene: Option<&Node>) -> Result<Scene, InputError> {
    let missing = || {
        stage
            .error("this stage needs a scene, but the pipeline has none")
            .help("add `scene: FILE` or an inline mapping")
    };
    checked_scene(scene.ok_or_else(missing)?)
}

/// The key of a stage that simulates one drive, with its schema.
const STATE: &str = "state";

fn with_state(fields: Fields) -> Fields {
    let schema = Schema::matching(&States::name_pattern());
    fields.optional(
        STATE,
        schema.description("The state of the device to simulate, if the scene has several."),
    )
}

/// The same for a stage that knows one drive.
fn scene_of(stage: &Node, scene: Option<&Node>) -> Result<Scene, InputError> {
    let read = scene_in_states_of(stage, scene)?;
    let names: Vec<&str> = read.states.iter().map(|(name, _)| name).collect();
    match stage.peek(STATE) {
        Some(node) => {
            let state = read.in_state(node.text(STATE)?);
            state.map_err(|unknown| node.error(unknown.to_string()).help(unknown.help()))
        }
        None if names.is_empty() => Ok(read),
        None => Err(stage
            .error("this stage simulates one drive, and does not say in which `state` of the scene")
            .help(format!(
                "allowed: {}; `design` and `verify` stages simulate all",
                names.join(", ")
            ))),
    }
}

/// The outline of a pipeline that has a scene, as those see it who draw on it: a square has some side.
fn outline_of(scene: Option<&Node>) -> Result<Option<Outline>, InputError> {
    scene.map(Outline::read).transpose()
}

/// What a stage that simulates depends on of the pipeline's scene: the parts that decide about its results, so that nothing else is in its
/// key or its artifact.
fn simulated_scene_of(stage: &Node, scene: Option<&Node>) -> Result<Scene, InputError> {
    Ok(scene_of(stage, scene)?.simulated())
}

/// The device of a scene, as the rows of datasets see it.
fn device_of(scene: &Scene) -> Device {
    let parts = scene.parts();
    Device::new(scene.membrane(), scene.groups(), scene.symmetries(), parts.as_deref())
}

/// Whether a device is that of the source paper: a square of 50 × 50 cells with equal prestretch, clamped on its edges, and one group of
/// electrodes.
fn is_of_paper(outline: &Outline) -> bool {
    let Outline {
        membrane,
        prestretch: [along, across],
        has_frame,
        has_bodies,
        groups,
    } = outline;
    let [width, height] = membrane.size_mm;
    let is_plain = !has_frame && !has_bodies && *groups == 1;
    is_plain && membrane.raster == Raster::PAPER && width == height && along == across
}

/// A scene that can be simulated, or where it cannot. What `effects: auto` would turn on is checked as far as that is known
/// without a solution.
fn checked_scene(node: &Node) -> Result<Scene, InputError> {
    let scene = Scene::read(node)?;
    let mut effects = scene.effects.clone();
    if scene.auto {
        effects.strain_stiffening = scene.properties.strain_stiffening.clone();
    }
    let decided = scene.with_effects(effects);
    let states = decided.in_states();
    match states.iter().find_map(|(_, scene)| Model::new(scene).err()) {
        None => Ok(scene),
        Some(error) => {
            let section = if scene.auto { "properties" } else { "effects" };
            Err(node.peek(section).unwrap_or(node).error(error.to_string()))
        }
    }
}

/// The scene that all inputs were made with; inputs of different scenes do not belong in one model.
fn scene_of_inputs(inputs: &[Artifact]) -> Result<Scene, StageError> {
    let mut found: Option<Scene> = None;
    for input in inputs {
        let missing = || {
            let digest = input.digest().short();
            StageError::input(format!("artifact {digest} does not say which scene it was made with"))
        };
        let scene: Option<Scene> = StoredAttribute::new(input, "scene").read()?;
        let scene = scene.ok_or_else(missing)?;
        match &found {
            Some(other) if *other != scene => return Err(differ(other, &scene)),
            _ => found = Some(scene),
        }
    }
    found.ok_or_else(|| StageError::input("the stage has no inputs"))
}

/// What is said of inputs of different scenes.
fn differ(one: &Scene, other: &Scene) -> StageError {
    let list = match one.differences(other) {
        differences if differences.is_empty() => String::new(),
        differences => format!(": {}", Difference::listed(&differences)),
    };
    StageError::input(format!("the inputs were made with different scenes{list}"))
}
