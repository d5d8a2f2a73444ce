//! Rigid inclusion: a rigid part on the membrane; not simulated yet.

use super::effect::{Assessment, Effect};
use crate::scene::Scene;
use crate::scene::effects::names;

/// The effect.
pub struct RigidInclusion;

impl Effect for RigidInclusion {
    fn name(&self) -> &'static str {
        names::INCLUSION
    }

    fn cost(&self) -> &'static str {
        "one more solve"
    }

    fn assess(&self, _scene: &Scene) -> Option<Assessment> {
        Some(Assessment::does_not_arise("the scene has no rigid part"))
    }
}
