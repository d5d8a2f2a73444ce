//! Strain stiffening of elastomers with finite chains. The laws are in [`deaflow_scene::laws`], their kernels in
//! [`crate::energy`].

use super::effect::{Effect, Significance, switch};
use super::strip::Strips;
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct StrainStiffening;

impl Effect for StrainStiffening {
    fn name(&self) -> &'static str {
        names::STIFFENING
    }

    fn cost(&self) -> &'static str {
        "2.3× a solve, Ogden 3 to 4×"
    }

    switch!(strain_stiffening);

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.strain_stiffening = scene.properties.strain_stiffening.clone();
    }

    fn changes_displacement(&self) -> bool {
        true
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        let unknown = scene.effects.strain_stiffening.is_none() && scene.properties.strain_stiffening.is_none();
        unknown.then(|| Significance::lacks_data(&format!("Jm < {:.0}", Strips::new(scene).significant_jm())))
    }
}
