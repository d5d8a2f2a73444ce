//! What a pipeline leaves out of its simulations.

use crate::fem::SetupError;
use crate::fem::screening::Screened;
use crate::orchestrator::Pipeline;
use crate::scene::Scene;

/// What stages of a pipeline neglect although it matters, after the names of those among `stages` that simulate. It depends on parts of the
/// scene that decide about no result (how the drive goes on in time, what is known of the material), so it stands in no artifact.
///
/// # Errors
/// When the effects of the scene cannot be simulated.
pub fn neglected(pipeline: &Pipeline, stages: &[&str]) -> Result<Vec<String>, SetupError> {
    let mut scenes: Vec<(Scene, Vec<&str>)> = Vec::new();
    for stage in &pipeline.stages {
        if !SIMULATING.contains(&stage.kind.name()) || !stages.contains(&stage.name.as_str()) {
            continue;
        }
        let node = stage.scene.as_ref().or(pipeline.scene.as_ref());
        // A pipeline is read with its scenes, so these can be read too.
        let Some(Ok(scene)) = node.map(Scene::read) else {
            continue;
        };
        match scenes.iter_mut().find(|(known, _)| *known == scene) {
            Some((_, names)) => names.push(&stage.name),
            None => scenes.push((scene, vec![&stage.name])),
        }
    }
    let mut warnings = Vec::new();
    let looked_at = scenes.len().min(MOST_SCENES);
    for (scene, names) in &scenes[..looked_at] {
        let found = Screened::new(scene)?.warnings;
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
