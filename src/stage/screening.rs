//! Screening as stages and commands use it.

use std::path::Path;

use super::arrays;
use super::direct::{DirectError, read_scene};
use crate::base::InputError;
use crate::fem::SetupError;
use crate::fem::screening;
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
        let patterns = arrays::named_patterns(argument)?;
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
