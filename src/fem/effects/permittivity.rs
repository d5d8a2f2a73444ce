//! Stretch-dependent permittivity, with the energy of [`Decaying`](crate::energy::Decaying).

use super::effect::{Effect, Significance, switch};
use super::strip::Strips;
use deaflow_base::two_digits;
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct StretchDependentPermittivity;

impl Effect for StretchDependentPermittivity {
    fn name(&self) -> &'static str {
        names::PERMITTIVITY
    }

    fn cost(&self) -> &'static str {
        "2× a solve"
    }

    switch!(stretch_dependent_permittivity);

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.stretch_dependent_permittivity = scene.properties.stretch_dependent_permittivity.clone();
    }

    fn changes_displacement(&self) -> bool {
        true
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        let [on, known] = [
            &scene.effects.stretch_dependent_permittivity,
            &scene.properties.stretch_dependent_permittivity,
        ];
        (on.is_none() && known.is_none())
            .then(|| Significance::lacks_data(&format!("s > {}", two_digits(Strips::new(scene).significant_decay()))))
    }
}
