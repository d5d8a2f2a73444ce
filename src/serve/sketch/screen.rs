//! Screening: which effects are significant for a drawn pattern.

use super::request::SketchRequest;
use crate::http::{ApiError, Request, Response};
use crate::state::ServerState;
use deaflow_fem::screening::{TestPattern, resolve, screen as screened};

/// Screens the scene with the pattern, as `deaflow screen SCENE PATTERN`.
///
/// # Errors
/// If the request is invalid, or the effects cannot be simulated.
pub fn screen(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let drawn: SketchRequest = request.json()?;
    let setup = drawn.setup(state)?;
    let pattern = drawn.pattern(&setup.scene)?;
    let scene = resolve(&setup.scene)?;
    Ok(screened(&scene, &[TestPattern::new("drawn", pattern)])?
        .document()
        .into())
}
