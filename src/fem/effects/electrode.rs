//! Electrode stiffness: a layer of neo-Hookean electrode on the prestretched membrane, free of stress there.
//!
//! A layer of shear modulus μₑ and thickness Hₑ adds μₑHₑ ½(i + j⁻² − 3) per prestretched area where the membrane is
//! active; in units of μH that is χ = μₑHₑ/μH times ½(i + j⁻² − 3). (It is the composite membrane of, for instance,
//! Bozlar et al., Appl. Phys. Lett. 101 (2012) 091907, with thin electrodes.) The effect vanishes as χ → 0.

use super::effect::{Effect, Significance, switch};
use super::strip::Strips;
use crate::energy::{Invariants, Slopes};
use crate::lanes::Value;
use deaflow_base::two_digits;
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Electrode, Scene};

/// Electrodes with stiffness χ, which may be 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiff {
    /// χ = μₑHₑ/μH.
    pub ratio: f64,
}

impl Stiff {
    /// Creates the electrodes of a scene.
    #[must_use]
    pub fn new(scene: &Scene, electrode: &Electrode) -> Self {
        let layer = electrode.shear_modulus.value() * electrode.thickness.value();
        Self {
            ratio: layer / (scene.shear_modulus_pa() * scene.thickness_mm()),
        }
    }

    /// Returns φ of an active point.
    #[inline(always)]
    pub fn energy<V: Value>(&self, at: &Invariants<V>) -> V {
        let thinning = at.dilation * (at.area + at.area.constant(1.0)) * (at.inverse * at.inverse);
        at.area.constant(0.5 * self.ratio) * (at.growth() - thinning)
    }

    /// Returns the derivatives of φ of an active point.
    #[inline(always)]
    pub fn slopes<V: Value>(&self, at: &Invariants<V>) -> Slopes<V> {
        let stiffness = at.area.constant(self.ratio);
        let cubic = stiffness * at.inverse * (at.inverse * at.inverse);
        Slopes {
            // χ(1 − j⁻³): the layer is free of stress at rest.
            pressure: cubic * at.cube_minus_one(),
            i: stiffness,
            ..Slopes::of_area(-cubic, at.area.constant(3.0) * at.inverse * cubic)
        }
    }
}

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
