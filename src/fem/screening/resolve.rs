//! The scene with its effects decided, and its model warnings.

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::examine::Purpose;
use super::row::{Row, Status};
use super::screen::{screen_for_warnings, screen_to};
use super::test_pattern::{TestPattern, reference_patterns};
use crate::effects::Examined;
use crate::{SetupError, WorkLimit};
use deaflow_base::is_interrupted;
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// Share of the work for a pattern that the warnings of a run may take in addition.
const WARNING_SHARE: f64 = 0.4;
/// Number of cells from which on this share holds: on fewer, solutions take as many steps and less time, so that the
/// share of a small membrane would end in the middle of a solution.
const MANY_CELLS: f64 = 2500.0;
/// Largest number of cached decisions of a process.
const MAX_CACHED: usize = 16;

/// A scene with its effects decided, and warnings about the neglected ones.
pub struct ScreenedScene {
    /// The scene with its effects decided.
    pub scene: Scene,
    /// One line for each significant effect that an equilibrium neglects, and one with the effects that were not
    /// checked, because the scene has no data about them.
    pub warnings: Vec<String>,
    /// The same for a history.
    pub warnings_in_time: Vec<String>,
    /// A line if a pattern comes close to breakdown and this effect is on. Results with the electric field of each
    /// pattern relative to the breakdown field say this already.
    pub breakdown_warning: Option<String>,
}

impl ScreenedScene {
    /// Decides the effects of a scene, and screens it for the neglected ones with some of the patterns that are
    /// simulated in it, and a work limit for each. With `effects: auto` a comparison is with the decided effects.
    ///
    /// # Errors
    /// If its effects cannot be simulated.
    pub fn for_patterns(scene: &Scene, patterns: &[TestPattern], limit: WorkLimit) -> Result<Self, SetupError> {
        Self::screened(scene, patterns, None, limit)
    }

    /// Like [`ScreenedScene::for_patterns`], with the solutions of all patterns that were simulated: what these tell is
    /// not solved for again. Without any of the patterns nothing is solved.
    ///
    /// # Errors
    /// As [`ScreenedScene::for_patterns`].
    pub fn for_solutions(
        scene: &Scene,
        patterns: &[TestPattern],
        solved: &[Examined],
        limit: WorkLimit,
    ) -> Result<Self, SetupError> {
        Self::screened(scene, patterns, Some(solved), limit)
    }

    fn screened(
        scene: &Scene,
        patterns: &[TestPattern],
        solved: Option<&[Examined]>,
        limit: WorkLimit,
    ) -> Result<Self, SetupError> {
        let scene = resolve(scene)?;
        let cells = scene.membrane().raster.cells() as f64;
        let work = limit.part(WARNING_SHARE * (MANY_CELLS / cells).max(1.0));
        let mut screening = screen_for_warnings(&scene, patterns, solved, work)?;
        let is_observed = |row: &Row| row.effect == names::BREAKDOWN && row.status == Status::On;
        let (observed, rows) = screening.rows.into_iter().partition(is_observed);
        screening.rows = rows;
        let observed: Vec<Row> = observed;
        // Without patterns no effect is checked.
        let not_checked = screening.not_checked().filter(|_| !patterns.is_empty());
        let with_unchecked = |warnings: Vec<String>| warnings.into_iter().chain(not_checked.clone()).collect();
        Ok(Self {
            breakdown_warning: observed.iter().find_map(Row::warning),
            warnings: with_unchecked(screening.warnings_of_equilibrium()),
            warnings_in_time: with_unchecked(screening.warnings()),
            scene: screening.scene,
        })
    }

    /// Returns the simulated effects in the text form of artifacts.
    #[must_use]
    pub fn effects(&self) -> String {
        self.scene.effects.to_text()
    }
}

/// Decisions of this process, because each stage of a pipeline needs them.
static DECIDED: Mutex<Vec<(Scene, Effects)>> = Mutex::new(Vec::new());

/// A single push changes the decisions, so a panic elsewhere leaves a valid list.
fn decided() -> MutexGuard<'static, Vec<(Scene, Effects)>> {
    DECIDED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps the effects of a scene with `effects: auto` that were decided before, by [`resolve`] of the same program.
pub fn remember(scene: &Scene, effects: &Effects) {
    let mut decided = decided();
    if decided.len() < MAX_CACHED {
        decided.push((scene.clone(), effects.clone()));
    }
}

/// Decides the effects of a scene. It depends on the scene alone, not on the patterns or work limit of a stage, so that
/// all stages of a pipeline simulate the same.
fn decide(scene: &Scene) -> Result<Scene, SetupError> {
    let known = decided()
        .iter()
        .find(|(other, _)| other == scene)
        .map(|(_, known)| known.clone());
    if let Some(known) = known {
        return Ok(scene.with_effects(known));
    }
    let limit = WorkLimit::default();
    let screening = screen_to(Purpose::Decision, scene, &reference_patterns(scene), limit)?;
    if !is_interrupted() {
        remember(scene, &screening.scene.effects);
    }
    Ok(screening.scene)
}

/// Decides the effects of a scene with states at the largest voltage of each group of electrodes; returns a scene
/// without states unchanged.
///
/// # Errors
/// If its effects cannot be simulated.
pub fn resolve_states(scene: &Scene) -> Result<Scene, SetupError> {
    match scene.auto && !scene.states.is_empty() {
        true => Ok(scene.with_effects(decide(&scene.at_largest_voltages())?.effects)),
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

/// Decides the effects of a scene; returns it unchanged unless it says `effects: auto`. In space they are those of the
/// flat membrane, without a fringe field, which is not simulated there.
///
/// # Errors
/// If its effects cannot be simulated.
pub fn resolve(scene: &Scene) -> Result<Scene, SetupError> {
    if !scene.auto {
        return Ok(scene.clone());
    }
    if !scene.is_in_space() {
        return decide(scene);
    }
    let mut flat = decide(&scene.in_plane())?;
    flat.effects.fringe_field = None;
    Ok(Scene {
        loads: scene.loads.clone(),
        geometry: scene.geometry.clone(),
        ..flat
    })
}
