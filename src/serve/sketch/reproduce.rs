//! How to reproduce the numbers of a drawn pattern: the command that prints them, and the stages that compute them.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::request::SketchRequest;
use crate::cache::SimulationSetup;
use crate::http::{ApiError, Request, Response};
use crate::state::ServerState;
use deaflow_base::{Canonical, is_plain_name};
use deaflow_fem::{Method, SolverParameters};
use deaflow_report::shell_word as quoted;
use deaflow_scene::Scene;

/// The default name of a pattern.
const DEFAULT_NAME: &str = "mine";

/// The longest name of a pattern.
const MAX_NAME: usize = 64;

/// Returns a command, stages and a pipeline that simulate a drawn pattern with the requested state, voltage, effects,
/// method and mesh. Nothing is simulated.
///
/// # Errors
/// If the request is invalid.
pub fn reproduce(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let drawn: SketchRequest = request.json()?;
    let setup = drawn.setup(state)?;
    let name = drawn.name.as_deref().unwrap_or(DEFAULT_NAME);
    if !is_plain_name(name, MAX_NAME) {
        return Err(ApiError::bad_request(format!("invalid `name`: {name:?}"))
            .help(format!("allowed: letters, digits, `-` and `_`, at most {MAX_NAME}")));
    }
    let file = scene_file(state, &drawn);
    let base = base_scene(state, &drawn)?;
    let set = changes(&drawn, &base, &setup.scene);
    let set: Vec<String> = set.iter().map(|set| format!("scene.{set}")).collect();
    let of_pipeline = file.as_ref().filter(|file| {
        let all = state.pipelines().unwrap_or_default();
        all.contains(file)
    });
    let in_state = named_state(&drawn, &base);
    let run = of_pipeline.map(|file| {
        let options: String = set.iter().map(|set| format!(" --set {}", quoted(set))).collect();
        format!("deaflow run {} --until {name}-solved{options}", near(file))
    });
    // A scene without a file, as of the gallery, is that of the complete pipeline, as it is shown.
    let saved = file.is_none().then(|| format!("{name}.yaml"));
    let command = match &file {
        Some(file) => command(&drawn, &setup, (file, name), in_state.as_deref(), &set)?,
        None => command(&drawn, &setup, (Path::new(&format!("{name}.yaml")), name), None, &[])?,
    };
    Ok(json!({
        "command": command,
        "saved": saved,
        "set": set,
        "stages": stages(&setup, name, in_state.as_deref()),
        "run": run,
        "pipeline": format!(
            "version: 1\nname: {name}\nscene: {}\nstages:\n{}",
            setup.scene.to_text(),
            stages(&setup, name, None)
        ),
    })
    .into())
}

/// Returns the file of the scene, if it is one that is served.
fn scene_file(state: &ServerState, drawn: &SketchRequest) -> Option<PathBuf> {
    let found = match &drawn.scene {
        None => state.named_scene(None),
        Some(Value::String(name)) => state.named_scene(Some(name)),
        Some(_) => None,
    };
    found?.file
}

/// Returns the scene as in its file, with its states.
fn base_scene(state: &ServerState, drawn: &SketchRequest) -> Result<Scene, ApiError> {
    let plain = SketchRequest {
        scene: drawn.scene.clone(),
        ..SketchRequest::default()
    };
    plain.with_states(state)
}

/// Returns the name of the simulated state, if the scene has several.
fn named_state(drawn: &SketchRequest, base: &Scene) -> Option<String> {
    let first = || base.states.iter().next().map(|(name, _)| name.to_owned());
    drawn.state.clone().or_else(first)
}

/// Returns the changes of the scene of a file, as for `deaflow solve --set`.
fn changes(drawn: &SketchRequest, base: &Scene, scene: &Scene) -> Vec<String> {
    let named = named_state(drawn, base);
    let own = named.as_ref().and_then(|name| base.in_state(name).ok());
    let own = own.unwrap_or_else(|| base.clone());
    let (before, now) = (sections(&own), sections(scene));
    let mut found = Vec::new();
    let voltages = |of: &[Option<Canonical>; 2]| -> Vec<(&'static str, String)> {
        let Some(Canonical::Map(drive)) = &of[0] else {
            return Vec::new();
        };
        let keys = ["voltage", "voltages"].into_iter();
        keys.filter_map(|key| Some((key, drive.get(key)?.to_string())))
            .collect()
    };
    for (key, value) in voltages(&now) {
        if voltages(&before).contains(&(key, value.clone())) {
            continue;
        }
        found.push(match &named {
            Some(name) => format!("states.{name}={{ {key}: {value} }}"),
            None => format!("drive.{key}={value}"),
        });
    }
    if let [_, Some(effects)] = &now
        && now[1] != before[1]
    {
        found.push(format!("effects={effects}"));
    }
    found
}

/// Returns the drive and the effects of a scene in canonical form.
fn sections(scene: &Scene) -> [Option<Canonical>; 2] {
    let Canonical::Map(sections) = scene.canonical() else {
        return [None, None];
    };
    ["drive", "effects"].map(|name| sections.get(name).cloned())
}

fn command(
    drawn: &SketchRequest,
    setup: &SimulationSetup,
    (file, name): (&Path, &str),
    state: Option<&str>,
    set: &[String],
) -> Result<String, ApiError> {
    let scene = near(file);
    let mut words = vec![format!("deaflow solve {scene} {name}.csv")];
    words.extend(state.map(|state| format!("--state {}", quoted(state))));
    let set = set.iter().filter_map(|set| set.strip_prefix("scene."));
    words.extend(set.map(|set| format!("--set {}", quoted(set))));
    if setup.method != Method::Newton {
        words.push(format!("--method {}", setup.method));
    }
    let mesh = setup.mesh;
    words.push(format!(
        "--elements-per-cell {} --order {}",
        mesh.elements_per_cell(),
        mesh.order().degree()
    ));
    if let Some(([x, y], angle)) = drawn.point_and_direction(&setup.scene)? {
        words.push(format!("--point '{x} mm,{y} mm' --direction '{angle} deg'"));
    }
    // The table has fewer digits.
    words.push("--json".to_owned());
    Ok(words.join(" "))
}

fn stages(setup: &SimulationSetup, name: &str, state: Option<&str>) -> String {
    let state = state.map_or_else(String::new, |state| format!("state: {state}, "));
    let solver = SolverParameters::new(setup.method, setup.mesh);
    format!(
        "  {name}: {{ kind: patterns, files: [{name}.csv] }}\n  \
         {name}-solved: {{ kind: solve, needs: [{name}], {state}{solver} }}\n"
    )
}

/// Returns a path relative to the working directory of the server, quoted for a shell.
fn near(path: &Path) -> String {
    let here = std::env::current_dir().ok();
    let near = here.and_then(|here| path.strip_prefix(here).ok().map(Path::to_owned));
    quoted(&near.unwrap_or_else(|| path.to_owned()).to_string_lossy())
}
