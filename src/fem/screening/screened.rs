//! A scene as it is simulated.

use super::screen::{Screening, screen_to};
use super::solution::Purpose;
use super::trial::{Trial, reference_patterns, watch_patterns, watch_patterns_with};
use crate::fem::{SetupError, WorkLimit};
use crate::pattern::Pattern;
use crate::scene::Scene;

/// The part of the work for a pattern that a run's warnings may take beside it.
const WATCHING: f64 = 0.4;

/// A scene as it is simulated, with what it lacks.
pub struct Screened {
    /// The scene with its effects decided.
    pub scene: Scene,
    /// One line for each effect that is called for and not simulated.
    pub warnings: Vec<String>,
}

impl Screened {
    /// Screens a scene with [`watch_patterns`]; where its effects are yet to be decided, the screening that
    /// decides them tells of both.
    ///
    /// # Errors
    /// When its effects cannot be simulated.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        Self::with(scene, &watch_patterns(), WorkLimit::default())
    }

    /// The same for patterns that are about to be simulated, within a limit of work for each.
    ///
    /// # Errors
    /// When its effects cannot be simulated.
    pub fn for_patterns(scene: &Scene, patterns: &[Pattern], limit: WorkLimit) -> Result<Self, SetupError> {
        Self::with(scene, &watch_patterns_with(patterns), limit)
    }

    fn with(scene: &Scene, patterns: &[Trial], limit: WorkLimit) -> Result<Self, SetupError> {
        let screening = if scene.auto {
            decide(scene, limit)?
        } else {
            screen_to(Purpose::Watch, scene, patterns, limit.part(WATCHING))?
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

/// The screening that decides about the effects of a scene: it looks at the scene alone, not at the patterns to come.
fn decide(scene: &Scene, limit: WorkLimit) -> Result<Screening, SetupError> {
    screen_to(Purpose::Decision, scene, &reference_patterns(), limit)
}

/// The scene with its effects decided: unchanged unless it says `effects: auto`.
///
/// # Errors
/// When its effects cannot be simulated.
pub fn resolve(scene: &Scene) -> Result<Scene, SetupError> {
    resolve_within(scene, WorkLimit::default())
}

/// The same within a limit of work for each pattern.
///
/// # Errors
/// As [`resolve`].
pub fn resolve_within(scene: &Scene, limit: WorkLimit) -> Result<Scene, SetupError> {
    if scene.auto {
        Ok(decide(scene, limit)?.scene)
    } else {
        Ok(scene.clone())
    }
}
