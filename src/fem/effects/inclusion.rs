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

    fn assess(&self, scene: &Scene) -> Option<Assessment> {
        Some(Assessment::does_not_arise(match &scene.geometry.bodies {
            Some(_) => "the bodies of the geometry are rigid, and nothing else is",
            None => "the scene has no rigid part",
        }))
    }
}
