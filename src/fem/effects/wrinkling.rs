//! Wrinkling by tension-field theory, with the energy of [`TensionField`](crate::energy::TensionField).

use super::effect::{Effect, switch};
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, On, Scene};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct Wrinkling;

impl Effect for Wrinkling {
    fn name(&self) -> &'static str {
        names::WRINKLING
    }

    fn cost(&self) -> &'static str {
        "2.3× a solve, more where it wrinkles"
    }

    switch!(wrinkling);

    fn turn_on(&self, effects: &mut Effects, _scene: &Scene) {
        effects.wrinkling = Some(On {});
    }

    fn changes_displacement(&self) -> bool {
        true
    }
}
