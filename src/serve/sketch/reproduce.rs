//! How the numbers of a drawn pattern come out elsewhere: the command that prints them, and the stages that have them.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::drawn::Drawn;
use crate::held::Setting;
use crate::http::{Answer, Refusal, Request};
use crate::state::ServedState;
use deaflow_base::{Canonical, is_plain_name};
use deaflow_fem::{Method, SolverParameters};
use deaflow_scene::Scene;

/// What a pattern is called unless it has a name.
const NAME: &str = "mine";

/// The file of a scene that has none.
const SCENE: &str = "scene.yaml";

/// Longest name of a pattern.
const LONGEST: usize = 64;

/// A command, stages and a whole pipeline that simulate a drawn pattern as it was asked for: in the state, at the voltage, with the effects, by
/// the method and on the mesh. Nothing is simulated.
///
/// # Errors
/// When the request is not understood.
pub fn reproduce(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let drawn: Drawn = request.json()?;
    let setting = drawn.setting(state)?;
    let name = drawn.name.as_deref().unwrap_or(NAME);
    if !is_plain_name(name, LONGEST) {
        return Err(Refusal::bad(format!("`name` cannot be {name:?}"))
            .help(format!("allowed: letters, digits, `-` and `_`, at most {LONGEST}")));
    }
    let file = file(state, &drawn);
    let base = base(state, &drawn)?;
    let set = changes(&drawn, &base, &setting.scene);
    let of_pipeline = file.as_ref().filter(|file| {
        let all = state.pipelines().unwrap_or_default();
        all.contains(file)
    });
    let in_state = named_state(&drawn, &base);
    let run = of_pipeline.map(|file| {
        let set = set
            .iter()
            .map(|set| format!(" --set {}", quoted(&format!("scene.{set}"))));
        format!(
            "deaflow run {} --until {name}-solved{}",
            near(file),
            set.collect::<String>()
        )
    });
    Ok(json!({
        "command": command(&drawn, &setting, (file.as_deref(), name), in_state.as_deref(), &set)?,
        "set": set.iter().map(|set| format!("scene.{set}")).collect::<Vec<_>>(),
        "stages": stages(&setting, name, in_state.as_deref()),
        "run": run,
        "pipeline": format!(
            "version: 1\nname: {name}\nscene: {}\nstages:\n{}",
            setting.scene.to_text(),
            stages(&setting, name, None)
        ),
    })
    .into())
}

/// The file of the scene that is meant, where it is one that is served.
fn file(state: &ServedState, drawn: &Drawn) -> Option<PathBuf> {
    let found = match &drawn.scene {
        None => state.named_scene(None),
        Some(Value::String(name)) => state.named_scene(Some(name)),
        Some(_) => None,
    };
    found?.file
}

/// The scene as its file has it, with its states.
fn base(state: &ServedState, drawn: &Drawn) -> Result<Scene, Refusal> {
    let plain = Drawn {
        scene: drawn.scene.clone(),
        ..Drawn::default()
    };
    plain.with_states(state)
}

/// The state that is simulated, where the scene has several.
fn named_state(drawn: &Drawn, base: &Scene) -> Option<String> {
    let first = || base.states.iter().next().map(|(name, _)| name.to_owned());
    drawn.state.clone().or_else(first)
}

/// What has to be changed in the scene of a file, as `deaflow solve --set` takes it.
fn changes(drawn: &Drawn, base: &Scene, scene: &Scene) -> Vec<String> {
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

/// The drive and the effects of a scene, as they are written.
fn sections(scene: &Scene) -> [Option<Canonical>; 2] {
    let Canonical::Map(sections) = scene.canonical() else {
        return [None, None];
    };
    ["drive", "effects"].map(|name| sections.get(name).cloned())
}

fn command(
    drawn: &Drawn,
    setting: &Setting,
    (file, name): (Option<&Path>, &str),
    state: Option<&str>,
    set: &[String],
) -> Result<String, Refusal> {
    let scene = file.map_or_else(|| SCENE.to_owned(), near);
    let mut words = vec![format!("deaflow solve {scene} {name}.csv")];
    words.extend(state.map(|state| format!("--state {}", quoted(state))));
    words.extend(set.iter().map(|set| format!("--set {}", quoted(set))));
    if setting.method != Method::Newton {
        words.push(format!("--method {}", setting.method));
    }
    let mesh = setting.mesh;
    words.push(format!(
        "--elements-per-cell {} --order {}",
        mesh.elements_per_cell(),
        mesh.order().degree()
    ));
    if let Some(([x, y], angle)) = drawn.place(&setting.scene)? {
        words.push(format!("--point '{x} mm,{y} mm' --direction '{angle} deg'"));
    }
    // In a table they have fewer digits.
    words.push("--json".to_owned());
    Ok(words.join(" "))
}

fn stages(setting: &Setting, name: &str, state: Option<&str>) -> String {
    let state = state.map_or_else(String::new, |state| format!("state: {state}, "));
    let solver = SolverParameters::new(setting.method, setting.mesh);
    format!(
        "  {name}: {{ kind: patterns, files: [{name}.csv] }}\n  {name}-solved: {{ kind: solve, needs: [{name}], {state}{solver} }}\n"
    )
}

/// A path as it is named where the server was started, in a shell.
fn near(path: &Path) -> String {
    let here = std::env::current_dir().ok();
    let near = here.and_then(|here| path.strip_prefix(here).ok().map(Path::to_owned));
    quoted(&near.unwrap_or_else(|| path.to_owned()).to_string_lossy())
}

/// A word of a shell.
fn quoted(word: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_./:,=+@%".contains(&byte);
    match !word.is_empty() && word.bytes().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_a_shell_are_quoted_where_it_reads_more_into_them() {
        assert_eq!(quoted("pipelines/quick-start.yaml"), "pipelines/quick-start.yaml");
        assert_eq!(quoted("drive.voltage=4000 V"), "'drive.voltage=4000 V'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
    }
}
