//! Charge control: the charge is prescribed, and the voltage follows.

use super::effect::{Effect, Significance, Verdict};
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct ChargeControl;

impl Effect for ChargeControl {
    fn name(&self) -> &'static str {
        names::CHARGE
    }

    fn cost(&self) -> &'static str {
        "the factors of a matrix for each step"
    }

    fn is_on(&self, effects: &Effects, _scene: &Scene) -> Option<bool> {
        Some(effects.charge_control.is_some())
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        Some(match &scene.drive.charge {
            Some(_) => Significance::open("–", Verdict::Significant, 0.0, "the drive is a charge"),
            None => Significance::not_applicable("the drive is a voltage"),
        })
    }
}
