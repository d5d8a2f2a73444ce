//! Strain stiffening: elastomers of finite chains. The laws, each with what screening compares, are in [`crate::scene::laws`];
//! their kernels are in [`crate::fem::energy`].

use super::effect::{Assessment, Effect, Verdict};
use crate::scene::effects::names;
use crate::scene::laws::AtRest;
use crate::scene::{Effects, Scene};

/// The effect.
pub struct StrainStiffening;

const THRESHOLD: f64 = 0.05;

impl Effect for StrainStiffening {
    fn name(&self) -> &'static str {
        names::STIFFENING
    }

    fn cost(&self) -> &'static str {
        "1.8× a solve, Ogden 4 to 6×"
    }

    fn is_on(&self, effects: &Effects) -> Option<bool> {
        Some(effects.strain_stiffening.is_some())
    }

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.strain_stiffening = scene.properties.strain_stiffening.clone();
    }

    fn assess(&self, scene: &Scene) -> Option<Assessment> {
        let at = AtRest {
            prestretch: scene.prestretch(),
            shear_modulus_pa: scene.shear_modulus_pa(),
        };
        let law = scene.effects.strain_stiffening.as_ref();
        let Some(law) = law.or(scene.properties.strain_stiffening.as_ref()) else {
            let change = format!("no data: matters if Jm < {:.0}", at.invariant() / THRESHOLD);
            return Some(Assessment::open("(I1 − 3)/Jm", Verdict::Unknown, THRESHOLD, change));
        };
        let significance = law.law().significance(&at);
        let change = format!(
            "changes the stress of the prestretched membrane by {:+.0} %",
            100.0 * significance.stress_change
        );
        Some(Assessment::known(
            significance.quantity,
            significance.number,
            THRESHOLD,
            change,
        ))
    }
}
