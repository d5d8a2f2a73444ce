//! What a pipeline leaves out of its simulations.

use crate::fem::SetupError;
use crate::fem::screening::Screened;
use crate::orchestrator::{Pipeline, StageSpec};
use crate::scene::Scene;

/// What stages of a pipeline neglect although it matters, after the names of those among `stages` that simulate. It depends on parts of the
/// scene that decide about no result (how the drive goes on in time, what is known of the material), so it stands in no artifact.
///
/// # Errors
/// When the effects of the scene cannot be simulated.
pub fn neglected(pipeline: &Pipeline, stages: &[&str]) -> Result<Vec<String>, SetupError> {
    let simulates =
        |stage: &&StageSpec| SIMULATING.contains(&stage.kind.name()) && stages.contains(&stage.name.as_str());
    let names: Vec<&str> = pipeline
        .stages
        .iter()
        .filter(simulates)
        .map(|stage| stage.name.as_str())
        .collect();
    let Some(scene) = pipeline.scene.as_ref().filter(|_| !names.is_empty()) else {
        return Ok(Vec::new());
    };
    // A pipeline is read with its scene, so this one can be read too.
    let Ok(scene) = Scene::read(scene) else {
        return Ok(Vec::new());
    };
    let warnings = Screened::new(&scene)?.warnings;
    Ok(warnings
        .iter()
        .map(|warning| format!("{}: {warning}", names.join(", ")))
        .collect())
}

/// The kinds whose stages simulate the scene and nothing else.
const SIMULATING: [&str; 2] = ["solve", "verify"];
