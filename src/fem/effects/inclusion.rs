//! Rigid inclusions: the bodies of the geometry, which are always simulated.

use super::effect::{Effect, Significance, Verdict};
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct RigidInclusion;

impl Effect for RigidInclusion {
    fn name(&self) -> &'static str {
        names::INCLUSION
    }

    fn cost(&self) -> &'static str {
        "one more solve"
    }

    fn is_on(&self, _effects: &Effects, scene: &Scene) -> Option<bool> {
        Some(scene.geometry.bodies.is_some())
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        Some(match &scene.geometry.bodies {
            Some(_) => Significance::open("–", Verdict::Significant, 0.0, "the geometry has rigid bodies"),
            None => Significance::not_applicable("the scene has no rigid part"),
        })
    }
}
