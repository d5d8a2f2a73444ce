//! What a pipeline leaves out of its simulations.

use std::io;
use std::thread::{Builder, JoinHandle};

use super::error::CliError;
use deaflow_base::{Digest, build};
use deaflow_content::SOLVED;
use deaflow_fem::screening::Screened;
use deaflow_orchestrator::{Pipeline, StageSpec};
use deaflow_scene::Scene;
use deaflow_store::Store;

/// What stages of a pipeline neglect although it matters, after the names of those among `stages` that simulate. It depends on parts of the
/// scene that decide about no result (how the drive goes on in time, what is known of the material), so it stands in no artifact.
///
/// # Errors
/// When the effects of the scene cannot be simulated.
pub fn neglected(pipeline: &Pipeline, stages: &[&str], store: &Store) -> Result<Vec<String>, CliError> {
    let scenes = scenes(pipeline, stages);
    let mut warnings = Vec::new();
    let looked_at = scenes.len().min(MOST_SCENES);
    for (simulated, names) in &scenes[..looked_at] {
        let found = screened(simulated, store)?;
        warnings.extend(found.iter().map(|warning| format!("{}: {warning}", list(names))));
    }
    if looked_at < scenes.len() {
        warnings.push(format!(
            "only the first {looked_at} of {} scenes were screened for effects that are left out; `deaflow screen` does any",
            scenes.len()
        ));
    }
    Ok(warnings)
}

/// Finds out in a thread of its own what [`neglected`] will ask for, which the store then knows. What fails is told there.
pub fn ahead(pipeline: &Pipeline, stages: &[&str], store: Store) -> io::Result<JoinHandle<()>> {
    let scenes = scenes(pipeline, stages).into_iter().take(MOST_SCENES);
    let scenes: Vec<Simulated> = scenes.map(|(simulated, _)| simulated).collect();
    let screen = move || {
        for simulated in &scenes {
            let _ = screened(simulated, &store);
        }
    };
    Builder::new().name("screening".to_owned()).spawn(screen)
}

/// A scene, and whether it is simulated in time.
type Simulated = (Scene, bool);

/// The scenes that stages simulate, with the names of these.
fn scenes<'a>(pipeline: &'a Pipeline, stages: &[&str]) -> Vec<(Simulated, Vec<&'a str>)> {
    let mut scenes: Vec<(Simulated, Vec<&str>)> = Vec::new();
    for stage in &pipeline.stages {
        if !SIMULATING.contains(&stage.kind.name()) || !stages.contains(&stage.name.as_str()) {
            continue;
        }
        // A pipeline is read with its scenes, so these can be read too.
        let Some(Ok(scene)) = pipeline.scene_of(stage).map(Scene::read) else {
            continue;
        };
        let says = |stage: &StageSpec, is: &dyn Fn(&str) -> bool| {
            let parameters = stage.stage.parameters();
            parameters.leaves().iter().any(|(key, _)| is(key))
        };
        // Designs for an amplitude are verified by the response, in which all effects in time are.
        let needed = stage.needs.iter().filter_map(|at| pipeline.stages.get(*at));
        let in_time = says(stage, &|key| key.starts_with("history"))
            || needed
                .into_iter()
                .any(|stage| says(stage, &|key| key.ends_with("objective.frequency")));
        match scenes.iter_mut().find(|(known, _)| *known == (scene.clone(), in_time)) {
            Some((_, names)) => names.push(&stage.name),
            None => scenes.push(((scene, in_time), vec![&stage.name])),
        }
    }
    scenes
}

/// The warnings of a scene. They follow from it and from this program alone, and take the time of some solutions, so a store keeps them.
fn screened((scene, in_time): &Simulated, store: &Store) -> Result<Vec<String>, CliError> {
    let sort = if *in_time { "warnings in time" } else { "warnings" };
    let of = Digest::of(format!("{sort} of {}\n{}", build(), scene.to_text()).as_bytes());
    if let Some(known) = store.memo(&of) {
        return Ok(known);
    }
    let screened = Screened::new(scene).map_err(|e| CliError::bad_input(e.to_string()))?;
    let found = if *in_time {
        screened.warnings_in_time
    } else {
        screened.warnings
    };
    // In a store that cannot be written they are found again the next time.
    store.put_memo(&of, &found).ok();
    Ok(found)
}

/// The stages that solve with an effect that tells of breakdown, or may: others need not be looked into for it.
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

/// Scenes of a sweep that are screened: each takes about as long as solving a few patterns.
const MOST_SCENES: usize = 8;

/// Names in a warning.
const NAMED: usize = 4;

fn list(names: &[&str]) -> String {
    let some = names.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        n if n > NAMED => format!("{some} and {} more", n - NAMED),
        _ => some,
    }
}

/// The kinds whose stages simulate the scene and nothing else.
const SIMULATING: [&str; 2] = ["solve", "verify"];
