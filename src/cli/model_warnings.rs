//! Warnings about effects that simulations neglect, of those about which a scene has data.

use deaflow_fem::effects::{EFFECTS, Effect};
use deaflow_fem::screening::{ScreenedScene, TestPattern, resolve_states, screen_for};
use deaflow_fem::{SetupError, WorkLimit};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Screens a scene for effects that the simulations of patterns neglect, a device at its largest voltages.
///
/// # Errors
/// If its effects cannot be simulated.
pub fn screened(scene: &Scene, tests: &[TestPattern]) -> Result<ScreenedScene, SetupError> {
    let largest = match scene.states.is_empty() {
        true => scene.clone(),
        false => resolve_states(scene)?.at_largest_voltages(),
    };
    ScreenedScene::for_patterns(&largest, tests, WorkLimit::default())
}

/// Warns of effects that matter for some equilibria of patterns and are off, a line each, and of those that were not
/// checked without data.
///
/// # Errors
/// If the effects of the scene cannot be simulated.
pub fn of_equilibria(scene: &Scene, patterns: &[Pattern]) -> Result<Vec<String>, SetupError> {
    Ok(screened(scene, &TestPattern::some_of(patterns, "pattern"))?.warnings)
}

/// The same about equilibria from which a motion starts: what an equilibrium ignores of the time does not count.
///
/// # Errors
/// If the effects of the scene cannot be simulated.
pub fn of_states_of_motion(scene: &Scene, patterns: &[Pattern]) -> Result<Vec<String>, SetupError> {
    let found = screened(scene, &TestPattern::some_of(patterns, "pattern"))?;
    let is_of_both = |line: &String| found.warnings_in_time.contains(line);
    Ok(found.warnings.into_iter().filter(is_of_both).collect())
}

/// Warns of strain stiffening that is off although the scene has its data: a membrane in space is not screened, and
/// stretches more than a flat one. A second line lists the effects that cannot be checked without data.
///
/// # Errors
/// If the effects of the scene cannot be simulated.
pub fn in_space(scene: &Scene) -> Result<Vec<String>, SetupError> {
    let is_off = scene.effects.strain_stiffening.is_none() && scene.properties.strain_stiffening.is_some();
    let stiffening = is_off.then(|| {
        "strain stiffening is off and was not checked in space, where it can matter: the scene has its data; add \
         `strain_stiffening: {}` to `effects`"
            .to_owned()
    });
    // Whether a scene has the data of an effect does not depend on patterns.
    let changing = EFFECTS.into_iter().filter(|effect| effect.changes_displacement());
    let changing: Vec<&dyn Effect> = changing.collect();
    let without_data = screen_for(&changing, &scene.in_plane(), &[])?.not_checked();
    Ok(stiffening.into_iter().chain(without_data).collect())
}
