//! Electrode stiffness: a layer of neo-Hookean electrode on the prestretched membrane, free of stress there.
//!
//! A layer of shear modulus μₑ and thickness Hₑ adds μₑHₑ ½(i + j⁻² − 3) per prestretched area where the membrane is
//! active; in units of μH that is χ = μₑHₑ/μH times ½(i + j⁻² − 3). (It is the composite membrane of, for instance,
//! Bozlar et al., Appl. Phys. Lett. 101 (2012) 091907, with thin electrodes.) The effect vanishes as χ → 0.

use super::potential::{Invariants, Slopes};
use crate::lanes::Value;
use deaflow_scene::{Electrode, Scene};

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
