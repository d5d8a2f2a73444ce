//! Electrode stiffness, with the energy of [`Stiff`](crate::energy::Stiff).

use super::effect::{Effect, Significance, switch};
use super::strip::Strips;
use deaflow_base::two_digits;
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct ElectrodeStiffness;

impl Effect for ElectrodeStiffness {
    fn name(&self) -> &'static str {
        names::ELECTRODE
    }

    fn cost(&self) -> &'static str {
        "1.7× a solve"
    }

    switch!(electrode_stiffness);

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.electrode_stiffness = scene.properties.electrode_stiffness.clone();
    }

    fn changes_displacement(&self) -> bool {
        true
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        let unknown = scene.effects.electrode_stiffness.is_none() && scene.properties.electrode_stiffness.is_none();
        unknown.then(|| {
            // Pa·mm are mN/m.
            let threshold =
                1e-3 * Strips::new(scene).significant_electrode() * scene.shear_modulus_pa() * scene.thickness_mm();
            Significance::lacks_data(&format!("μe He > {} N/m", two_digits(threshold)))
        })
    }
}
