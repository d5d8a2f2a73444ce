//! The effects that the simulations of a pipeline neglect.

use std::io;
use std::thread::{Builder, JoinHandle};

use super::CliError;
use deaflow_base::{Digest, build};
use deaflow_content::SOLVED;
use deaflow_fem::screening::ScreenedScene;
use deaflow_orchestrator::{Pipeline, StageSpec};
use deaflow_scene::Scene;
use deaflow_store::Store;

/// Returns a warning for each significant effect that simulating stages neglect, after the names of those stages. It
/// depends on
/// parts of the scene that affect no result (the drive in time, known material data), so artifacts do not contain it.
///
/// # Errors
/// When the effects of the scene cannot be simulated.
pub fn neglected_effects(pipeline: &Pipeline, stages: &[&str], store: &Store) -> Result<Vec<String>, CliError> {
    let scenes = scenes(pipeline, stages);
    let mut warnings = Vec::new();
    let screened_scenes = scenes.len().min(MAX_SCENES);
    for (simulated, names) in &scenes[..screened_scenes] {
        let found = screened(simulated, store)?;
        warnings.extend(found.iter().map(|warning| format!("{}: {warning}", list(names))));
    }
    if screened_scenes < scenes.len() {
        warnings.push(format!(
            "only the first {screened_scenes} of {} scenes were screened for neglected effects; use `deaflow screen` \
             for others",
            scenes.len()
        ));
    }
    Ok(warnings)
}

/// Computes in a thread what [`neglected_effects`] will need; the store caches it. Errors are reported there.
///
/// # Errors
/// When the thread cannot be started.
pub fn screen_in_background(pipeline: &Pipeline, stages: &[&str], store: Store) -> io::Result<JoinHandle<()>> {
    let scenes = scenes(pipeline, stages).into_iter().take(MAX_SCENES);
    let scenes: Vec<SimulatedScene> = scenes.map(|(simulated, _)| simulated).collect();
    let screen = move || {
        for simulated in &scenes {
            let _ = screened(simulated, &store);
        }
    };
    Builder::new().name("screening".to_owned()).spawn(screen)
}

/// A scene, and whether it is simulated in time.
type SimulatedScene = (Scene, bool);

/// Returns the scenes that stages simulate, with the names of the stages.
fn scenes<'a>(pipeline: &'a Pipeline, stages: &[&str]) -> Vec<(SimulatedScene, Vec<&'a str>)> {
    let mut scenes: Vec<(SimulatedScene, Vec<&str>)> = Vec::new();
    for stage in &pipeline.stages {
        if !SIMULATING.contains(&stage.kind.name()) || !stages.contains(&stage.name.as_str()) {
            continue;
        }
        // The pipeline has been read with its scenes, so they are valid.
        let Some(Ok(scene)) = pipeline.scene_of(stage).map(Scene::read) else {
            continue;
        };
        let has = |stage: &StageSpec, is: &dyn Fn(&str) -> bool| {
            let parameters = stage.stage.parameters();
            parameters.leaves().iter().any(|(key, _)| is(key))
        };
        // Designs for an amplitude are verified by the frequency response, which includes all effects in time.
        let needed = stage.needs.iter().filter_map(|at| pipeline.stages.get(*at));
        let in_time = has(stage, &|key| key.starts_with("history"))
            || needed
                .into_iter()
                .any(|stage| has(stage, &|key| key.ends_with("objective.frequency")));
        match scenes.iter_mut().find(|(known, _)| *known == (scene.clone(), in_time)) {
            Some((_, names)) => names.push(&stage.name),
            None => scenes.push(((scene, in_time), vec![&stage.name])),
        }
    }
    scenes
}

/// Returns the warnings of a scene. They depend only on the scene and this program and take the time of some solutions,
/// so the
/// store caches them.
fn screened((scene, in_time): &SimulatedScene, store: &Store) -> Result<Vec<String>, CliError> {
    let sort = if *in_time { "warnings in time" } else { "warnings" };
    let of = Digest::of(format!("{sort} of {}\n{}", build(), scene.to_text()).as_bytes());
    if let Some(known) = store.memo(&of) {
        return Ok(known);
    }
    let screened = ScreenedScene::new(scene).map_err(|e| CliError::bad_input(e.to_string()))?;
    let found = if *in_time {
        screened.warnings_in_time
    } else {
        screened.warnings
    };
    // A read-only store does not cache them.
    store.put_memo(&of, &found).ok();
    Ok(found)
}

/// Returns the solving stages whose scene has, or with `auto` may have, the effect of dielectric breakdown.
pub fn may_break_down(pipeline: &Pipeline) -> Vec<String> {
    let may = |stage: &&StageSpec| {
        let scene = pipeline.scene_of(stage).map(Scene::read);
        scene.is_some_and(|scene| scene.is_ok_and(|scene| scene.auto || scene.effects.dielectric_breakdown.is_some()))
    };
    pipeline
        .stages
        .iter()
        .filter(|stage| SOLVED.contains(&stage.kind.name()))
        .filter(may)
        .map(|stage| stage.name.clone())
        .collect()
}

/// The most scenes of a sweep that are screened; each takes as long as solving a few patterns.
const MAX_SCENES: usize = 8;

/// The most stages that a warning names.
const MAX_NAMED: usize = 4;

fn list(names: &[&str]) -> String {
    let some = names.iter().take(MAX_NAMED).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        n if n > MAX_NAMED => format!("{some} and {} more", n - MAX_NAMED),
        _ => some,
    }
}

/// The kinds of stages that only simulate the scene.
const SIMULATING: [&str; 2] = ["solve", "verify"];
