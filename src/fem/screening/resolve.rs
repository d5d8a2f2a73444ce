//! The scene with its effects decided, and its model warnings.

use std::sync::{Mutex, PoisonError};

use super::examine::Purpose;
use super::screen::{Screening, screen_to};
use super::test_pattern::{TestPattern, reference_patterns, warning_patterns, warning_patterns_with};
use crate::{SetupError, WorkLimit};
use deaflow_base::is_interrupted;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Share of the work for a pattern that the warnings of a run may take in addition.
const WARNING_SHARE: f64 = 0.4;
/// Largest number of cached decisions of a process.
const MAX_CACHED: usize = 16;

/// A scene with its effects decided, and warnings about the neglected ones.
pub struct ScreenedScene {
    /// The scene with its effects decided.
    pub scene: Scene,
    /// One line for each significant effect that an equilibrium neglects.
    pub warnings: Vec<String>,
    /// One line for each significant effect that a history neglects.
    pub warnings_in_time: Vec<String>,
}

impl ScreenedScene {
    /// Screens a scene with two test patterns. With `effects: auto` the same screening decides the effects and gives
    /// the warnings.
    ///
    /// # Errors
    /// If its effects cannot be simulated.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        Self::with(scene, &warning_patterns(scene), WorkLimit::default())
    }

    /// Like [`Self::new`], with some of the patterns to be simulated and a work limit for each.
    ///
    /// # Errors
    /// If its effects cannot be simulated.
    pub fn for_patterns(scene: &Scene, patterns: &[Pattern], limit: WorkLimit) -> Result<Self, SetupError> {
        Self::with(scene, &warning_patterns_with(scene, patterns), limit)
    }

    fn with(scene: &Scene, patterns: &[TestPattern], limit: WorkLimit) -> Result<Self, SetupError> {
        let screening = if scene.auto {
            decide(scene)?
        } else {
            screen_to(Purpose::Warnings, scene, patterns, limit.part(WARNING_SHARE))?
        };
        Ok(Self {
            warnings: screening.warnings_of_equilibrium(),
            warnings_in_time: screening.warnings(),
            scene: screening.scene,
        })
    }

    /// Returns the simulated effects in the text form of artifacts.
    #[must_use]
    pub fn effects(&self) -> String {
        self.scene.effects.to_text()
    }
}

/// Decides the effects of a scene. It depends on the scene alone, not on the patterns or work limit of a stage, so that
/// all stages of a pipeline simulate the same.
fn decide(scene: &Scene) -> Result<Screening, SetupError> {
    /// Decisions of this process, because each stage of a pipeline needs them.
    static DECIDED: Mutex<Vec<(Scene, Screening)>> = Mutex::new(Vec::new());
    // A single push changes it, so a panic elsewhere leaves a valid list.
    let decided = || DECIDED.lock().unwrap_or_else(PoisonError::into_inner);
    let known = decided()
        .iter()
        .find(|(other, _)| other == scene)
        .map(|(_, known)| known.clone());
    if let Some(known) = known {
        return Ok(known);
    }
    let screening = screen_to(
        Purpose::Decision,
        scene,
        &reference_patterns(scene),
        WorkLimit::default(),
    )?;
    let mut decided = decided();
    if decided.len() < MAX_CACHED && !is_interrupted() {
        decided.push((scene.clone(), screening.clone()));
    }
    Ok(screening)
}

/// Decides the effects of a scene with states at the largest voltage of each group of electrodes; returns a scene
/// without states unchanged.
///
/// # Errors
/// If its effects cannot be simulated.
pub fn resolve_states(scene: &Scene) -> Result<Scene, SetupError> {
    match scene.auto && !scene.states.is_empty() {
        true => Ok(scene.with_effects(decide(&scene.at_largest_voltages())?.scene.effects)),
        false => Ok(scene.clone()),
    }
}

/// Returns the scene in each of its states with its effects decided, or only the scene if it has no states.
///
/// # Errors
/// If its effects cannot be simulated.
pub fn resolved_states(scene: &Scene) -> Result<Vec<Scene>, SetupError> {
    let decided = resolve(&resolve_states(scene)?)?;
    Ok(decided.in_states().into_iter().map(|(_, scene)| scene).collect())
}

/// Decides the effects of a scene; returns it unchanged unless it says `effects: auto`.
///
/// # Errors
/// If its effects cannot be simulated.
pub fn resolve(scene: &Scene) -> Result<Scene, SetupError> {
    if scene.auto {
        Ok(decide(scene)?.scene)
    } else {
        Ok(scene.clone())
    }
}
