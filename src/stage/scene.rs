//! Reads and checks the scenes of stages.

use miette::Diagnostic;

use deaflow_base::{Canonical, Fields, InputError, Node, Parameter, Schema};
use deaflow_content::StoredAttribute;
use deaflow_dataset::Device;
use deaflow_fem::SetupError;
use deaflow_fem::effects::Model;
use deaflow_orchestrator::{StageError, axes_in};
use deaflow_scene::{Difference, Distribution, Outline, Scene, States, material_file, splice_material};
use deaflow_store::Artifact;

/// The key of the state of a stage that simulates one drive.
pub const STATE: &str = "state";

/// Declares [`STATE`].
pub fn with_state(fields: Fields) -> Fields {
    let schema = Schema::matching(&States::name_pattern());
    fields.optional(
        STATE,
        schema.description("The state of the device to simulate, if the scene has several."),
    )
}

/// Replaces the file of the material in a scene by its content. A name with an axis of a sweep stays until the axis has
/// a value.
pub fn complete(scene: &mut Node) -> Result<(), InputError> {
    match material_file(scene) {
        Some(named) if axes_in(named).is_empty() => splice_material(scene),
        _ => Ok(()),
    }
}

/// Reads a scene and checks that it can be simulated. What `effects: auto` would turn on is checked as far as that is
/// known without a solution.
pub fn read(node: &Node) -> Result<Scene, InputError> {
    let scene = Scene::read(node)?;
    let mut effects = scene.effects.clone();
    if scene.auto {
        effects.strain_stiffening = scene.properties.strain_stiffening.clone();
    }
    let decided = scene.with_effects(effects).in_plane();
    let states = decided.in_states();
    match states.iter().find_map(|(_, scene)| Model::new(scene).err()) {
        None => Ok(scene),
        Some(error) => {
            let section = if scene.auto { "properties" } else { "effects" };
            Err(node.peek(section).unwrap_or(node).error(error.to_string()))
        }
    }
}

/// Reads the scene of a stage with all states of its device, which stays in its plane; the pipeline must have one.
pub fn read_all_states(stage: &Node, scene: Option<&Node>) -> Result<Scene, InputError> {
    let read = read_in_space(stage, scene)?;
    match (SetupError::in_space(&read), scene) {
        (Some(error), Some(node)) => Err(what_moves_out_of_plane(node).error(error.to_string())),
        _ => Ok(read),
    }
}

/// Like [`read_all_states`], also of a device that leaves its plane.
pub fn read_in_space(stage: &Node, scene: Option<&Node>) -> Result<Scene, InputError> {
    let missing = || {
        stage
            .error("this stage needs a scene, but the pipeline has none")
            .help("add `scene: FILE` or an inline mapping")
    };
    read(scene.ok_or_else(missing)?)
}

/// Returns what moves a membrane out of its plane in a scene.
pub fn what_moves_out_of_plane(scene: &Node) -> &Node {
    let bodies = || scene.peek("geometry")?.peek("bodies");
    scene.peek("loads").or_else(bodies).unwrap_or(scene)
}

/// Reads the scene of a stage in the state that the stage names.
pub fn read_in_state(stage: &Node, scene: Option<&Node>) -> Result<Scene, InputError> {
    let read = read_all_states(stage, scene)?;
    let names: Vec<&str> = read.states.iter().map(|(name, _)| name).collect();
    match stage.peek(STATE) {
        Some(node) => {
            let state = read.in_state(node.text(STATE)?);
            state.map_err(|unknown| node.error(unknown.to_string()).help(unknown.help()))
        }
        None if names.is_empty() => Ok(read),
        None => Err(stage
            .error("this stage simulates one drive; name the `state` of the scene")
            .help(format!(
                "allowed: {}; `design` and `verify` stages simulate all states",
                names.join(", ")
            ))),
    }
}

/// Returns the error of a stage whose inputs are refused, with the help of the refusal.
pub fn refused(error: InputError) -> StageError {
    match Diagnostic::help(&error).map(|help| help.to_string()) {
        Some(help) => StageError::Advised {
            source: error.into(),
            help,
        },
        None => StageError::input(error),
    }
}

/// Adds a scene to the canonical parameters of a stage.
pub fn with_scene(parameters: Canonical, scene: &Scene) -> Canonical {
    let own = match parameters {
        Canonical::Map(own) => own,
        other => [("parameters".to_owned(), other)].into(),
    };
    Canonical::map(own.into_iter().chain([("scene".to_owned(), scene.canonical())]))
}

/// Writes the numbers without a unit in parameters, at a path and below it, in per cent: they are shares.
pub fn in_percent(parameters: &mut Canonical, path: &[&str]) {
    match (parameters, path) {
        (Canonical::Map(entries), [key, rest @ ..]) => {
            if let Some(value) = entries.get_mut(*key) {
                in_percent(value, rest);
            }
        }
        (Canonical::Map(entries), []) => entries.values_mut().for_each(|value| in_percent(value, &[])),
        (value, []) => {
            if let Canonical::Number(share, unit) = &*value
                && unit.is_empty()
            {
                *value = Canonical::Text(format!("{} %", share.scaled(2)));
            }
        }
        _ => {}
    }
}

/// Writes tolerances in parameters, at a path, as files have them: shares in per cent, and each factor in one value.
pub fn write_tolerances(parameters: &mut Canonical, path: &[&str]) {
    in_percent(parameters, path);
    let tolerances = path.iter().try_fold(parameters, |within, key| match within {
        Canonical::Map(entries) => entries.get_mut(*key),
        _ => None,
    });
    let Some(Canonical::Map(tolerances)) = tolerances else {
        return;
    };
    let normal = Distribution::Normal.canonical();
    for tolerance in tolerances.values_mut() {
        let Canonical::Map(factor) = &*tolerance else { continue };
        let is_normal = factor.get("distribution") == normal.as_ref();
        let short = factor.get("relative").filter(|_| is_normal).cloned();
        *tolerance = short.unwrap_or_else(|| Canonical::Text(tolerance.to_string()));
    }
}

/// Returns the device of a scene as datasets describe it.
pub fn device_of(scene: &Scene) -> Device {
    let (parts, borders) = (scene.parts(), scene.borders());
    let opening = borders.as_ref().and_then(|borders| borders.opening.as_ref());
    let symmetries = scene.symmetries();
    let device = Device::within(scene.membrane(), scene.groups(), symmetries, parts.as_deref(), opening);
    match &scene.geometry.sides {
        Some(sides) => device.with_free_sides(parts.as_deref(), |axis, end| sides.moves(axis, end)),
        None => device,
    }
}

/// Returns a number to add to the RECIPE of kinds whose area fractions are those in the scene of a pipeline.
///
/// # Errors
/// If the geometry is invalid.
pub fn area_revision(scene: Option<&Node>) -> Result<u32, InputError> {
    let free = scene.map(Outline::free_cells).transpose()?.flatten();
    Ok(Scene::area_revision(free.as_ref()))
}

/// Returns the scene of all inputs. A model cannot be made from inputs of different scenes.
pub fn of_inputs(inputs: &[Artifact]) -> Result<Scene, StageError> {
    let mut common: Option<Scene> = None;
    for input in inputs {
        let missing = || StageError::in_artifact(input, "it does not name the scene it was made with");
        let scene: Option<Scene> = StoredAttribute::new(input, "scene").read()?;
        let scene = scene.ok_or_else(missing)?;
        match &common {
            Some(other) if *other != scene => return Err(differ(other, &scene)),
            _ => common = Some(scene),
        }
    }
    common.ok_or_else(|| StageError::input("the stage has no inputs"))
}

fn differ(one: &Scene, other: &Scene) -> StageError {
    let list = match one.differences(other) {
        differences if differences.is_empty() => String::new(),
        differences => format!(": {}", Difference::listed(&differences)),
    };
    StageError::input(format!("the inputs were made with different scenes{list}"))
}
