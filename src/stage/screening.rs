//! Screening as stages and commands use it.

use std::path::Path;

use super::direct::{DirectError, read_scene};
use crate::base::InputError;
use crate::content::named_patterns;
use crate::fem::SetupError;
use crate::fem::screening;
use crate::orchestrator::{Pipeline, StageSpec};
use crate::scene::Scene;

use crate::fem::screening::Trial;
pub use crate::fem::screening::{Row, Screening, Status, Verdict};

/// A scene as it is simulated, with what it lacks.
pub struct Screened {
    /// The scene with its effects decided.
    pub scene: Scene,
    /// One line for each effect that is called for and not simulated.
    pub warnings: Vec<String>,
}

impl Screened {
    /// Screens a scene with [`screening::watch_patterns`]; where its effects are yet to be decided, the screening that
    /// decides them tells of both.
    ///
    /// # Errors
    /// When its effects cannot be simulated.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        let screening = if scene.auto {
            screening::screen_by_references(scene)?
        } else {
            screening::screen(scene, &screening::watch_patterns())?
        };
        Ok(Self {
            warnings: screening.warnings(),
            scene: screening.scene,
        })
    }

    /// The effects that are simulated, as artifacts name them.
    #[must_use]
    pub fn effects(&self) -> String {
        self.scene.effects.to_text()
    }
}

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

/// Screens the scene of a file, or of a pipeline, with the patterns that the arguments name or, where there are none, with
/// reference patterns.
///
/// # Errors
/// When the scene or a pattern cannot be read, or the effects cannot be simulated.
pub fn screen(scene: &Path, patterns: &[String]) -> Result<Screening, DirectError> {
    let scene = read_scene(scene)?;
    let patterns = if patterns.is_empty() {
        screening::reference_patterns()
    } else {
        named(patterns)?
    };
    screening::screen(&scene, &patterns).map_err(|e| DirectError::Failed(e.to_string()))
}

/// The patterns of each argument, named after it.
fn named(arguments: &[String]) -> Result<Vec<Trial>, InputError> {
    let mut all = Vec::new();
    for argument in arguments {
        let patterns = named_patterns(argument)?;
        let several = patterns.len() > 1;
        all.extend(patterns.into_iter().enumerate().map(|(i, pattern)| {
            let name = if several {
                format!("{argument}[{i}]")
            } else {
                argument.clone()
            };
            Trial::new(&name, pattern)
        }));
    }
    Ok(all)
}
