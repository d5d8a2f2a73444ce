//! Charge control: a charge is given, not a voltage; not simulated yet.

use super::effect::{Assessment, Effect};
use crate::scene::Scene;
use crate::scene::effects::names;

/// The effect.
pub struct ChargeControl;

impl Effect for ChargeControl {
    fn name(&self) -> &'static str {
        names::CHARGE
    }

    fn cost(&self) -> &'static str {
        "one more solve"
    }

    fn assess(&self, _scene: &Scene) -> Option<Assessment> {
        Some(Assessment::does_not_arise("the drive is a voltage"))
    }
}
