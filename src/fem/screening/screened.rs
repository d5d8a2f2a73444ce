//! A scene as it is simulated.

use std::sync::{Mutex, PoisonError};

use super::screen::{Screening, screen_to};
use super::solution::Purpose;
use super::trial::{Trial, reference_patterns, watch_patterns, watch_patterns_with};
use crate::{SetupError, WorkLimit};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// The part of the work for a pattern that a run's warnings may take beside it.
const WATCHING: f64 = 0.4;
/// Decisions that a process remembers.
const KEPT: usize = 16;

/// A scene as it is simulated, with what it lacks.
pub struct Screened {
    /// The scene with its effects decided.
    pub scene: Scene,
    /// One line for each effect that is called for and not simulated in an equilibrium.
    pub warnings: Vec<String>,
    /// The same of a history.
    pub warnings_in_time: Vec<String>,
}

impl Screened {
    /// Screens a scene with [`watch_patterns`]; where its effects are yet to be decided, the screening that
    /// decides them tells of both.
    ///
    /// # Errors
    /// When its effects cannot be simulated.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        Self::with(scene, &watch_patterns(scene), WorkLimit::default())
    }

    /// The same for patterns that are about to be simulated, within a limit of work for each.
    ///
    /// # Errors
    /// When its effects cannot be simulated.
    pub fn for_patterns(scene: &Scene, patterns: &[Pattern], limit: WorkLimit) -> Result<Self, SetupError> {
        Self::with(scene, &watch_patterns_with(scene, patterns), limit)
    }

    fn with(scene: &Scene, patterns: &[Trial], limit: WorkLimit) -> Result<Self, SetupError> {
        let screening = if scene.auto {
            decide(scene)?
        } else {
            screen_to(Purpose::Watch, scene, patterns, limit.part(WATCHING))?
        };
        Ok(Self {
            warnings: screening.warnings_of_equilibrium(),
            warnings_in_time: screening.warnings(),
            scene: screening.scene,
        })
    }

    /// The effects that are simulated, as artifacts name them.
    #[must_use]
    pub fn effects(&self) -> String {
        self.scene.effects.to_text()
    }
}

/// The screening that decides about the effects of a scene: it looks at the scene alone, not at the patterns to come or the work that
/// they are allowed, so that all stages of a pipeline simulate the same.
fn decide(scene: &Scene) -> Result<Screening, SetupError> {
    /// What this process has decided: each stage of a pipeline asks again.
    static DECIDED: Mutex<Vec<(Scene, Screening)>> = Mutex::new(Vec::new());
    // It is pushed to in one step: a panic elsewhere leaves a list that is right.
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
    if decided.len() < KEPT {
        decided.push((scene.clone(), screening.clone()));
    }
    Ok(screening)
}

/// The scene with the effects of its states decided, which are those that the largest voltage of each group of electrodes calls for; a scene
/// without states as it is.
///
/// # Errors
/// When its effects cannot be simulated.
pub fn resolve_states(scene: &Scene) -> Result<Scene, SetupError> {
    match scene.auto && !scene.states.is_empty() {
        true => Ok(scene.with_effects(decide(&scene.at_largest_voltages())?.scene.effects)),
        false => Ok(scene.clone()),
    }
}

/// The scene in each of its states, with its effects decided; itself where it has none.
///
/// # Errors
/// When its effects cannot be simulated.
pub fn decided_states(scene: &Scene) -> Result<Vec<Scene>, SetupError> {
    let decided = resolve(&resolve_states(scene)?)?;
    Ok(decided.in_states().into_iter().map(|(_, scene)| scene).collect())
}

/// The scene with its effects decided: unchanged unless it says `effects: auto`.
///
/// # Errors
/// When its effects cannot be simulated.
pub fn resolve(scene: &Scene) -> Result<Scene, SetupError> {
    if scene.auto {
        Ok(decide(scene)?.scene)
    } else {
        Ok(scene.clone())
    }
}
