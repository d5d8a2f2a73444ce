//! Which effects a drawn pattern calls for.

use super::drawn::Drawn;
use crate::http::{Answer, Refusal, Request};
use crate::state::ServedState;
use deaflow_fem::screening::{Trial, resolve, screen as screened};

/// Screens the scene with the pattern, as `deaflow screen SCENE PATTERN` does.
///
/// # Errors
/// When the request is not understood, or the effects cannot be simulated.
pub fn screen(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let drawn: Drawn = request.json()?;
    let setting = drawn.setting(state)?;
    let pattern = drawn.pattern(&setting.scene)?;
    let scene = resolve(&setting.scene)?;
    Ok(screened(&scene, &[Trial::new("drawn", pattern)])?.document().into())
}
