//! Checks of what a stage needs that the file already answers.

use super::scene;
use deaflow_base::{InputError, Node};
use deaflow_orchestrator::StageDeclaration;

/// Returns where `needs` names a stage.
fn named<'a>(stage: &StageDeclaration<'a>, name: &str) -> &'a Node {
    let needs = stage.node.peek("needs");
    let items = needs.and_then(|needs| needs.list("needs").ok()).unwrap_or_default();
    items
        .iter()
        .find(|item| item.is_text(name))
        .or(needs)
        .unwrap_or(stage.node)
}

/// Returns the number of needs of some kinds.
pub fn count(needs: &[StageDeclaration<'_>], kinds: &[&str]) -> usize {
    needs.iter().filter(|need| kinds.contains(&need.kind)).count()
}

/// Returns the error for a number of needs.
pub fn wrong_number(stage: &StageDeclaration<'_>, message: String, help: &str) -> InputError {
    stage.node.peek("needs").unwrap_or(stage.node).error(message).help(help)
}

/// Refuses labels of different states of the device: no network and no calibration is of two states.
///
/// # Errors
/// If two needs name different states.
pub fn one_state(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let state = |need: &StageDeclaration<'_>| need.node.peek(scene::STATE)?.text(scene::STATE).ok().map(str::to_owned);
    let mut states = needs.iter().filter_map(|need| Some((need.name, state(need)?)));
    let Some((first, one)) = states.next() else {
        return Ok(());
    };
    match states.find(|(_, other)| *other != one) {
        None => Ok(()),
        Some((name, other)) => Err(named(stage, name)
            .error(format!("`{first}` is of state `{one}` and `{name}` of state `{other}`"))
            .help("a stage reads labels of one state; use a stage for each state")),
    }
}

/// Refuses verified designs of a device with states in a training.
///
/// # Errors
/// If a need is a verify stage in a scene with states.
pub fn no_designs_in_states(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    for need in needs.iter().filter(|need| need.kind == "verify") {
        let has_states = need
            .scene
            .and_then(|node| scene::read(node).ok())
            .is_some_and(|scene| !scene.states.is_empty());
        if has_states {
            let message = format!(
                "`{}` simulates all states of the device, and a network is of one state",
                need.name
            );
            return Err(named(stage, need.name)
                .error(message)
                .help("remove it from `needs`, or remove `rounds`; solve patterns in a `state` to train on more"));
        }
    }
    Ok(())
}
