//! The potential of an elastomer that is a dielectric, with electrodes.

use super::dielectric::Decaying;
use super::elasticity::Elasticity;
use super::electrode::Stiff;
use super::potential::{Invariants, Potential, Rest, Slopes};
use crate::lanes::Value;

/// Elastomer, dielectric and electrodes at a prestretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compound<M> {
    elasticity: M,
    dielectric: Decaying,
    electrode: Stiff,
    /// a = λp⁻⁶.
    thickness: f64,
}

/// Largest number of Newton steps to a natural width without closed form; three or four are usual.
const WIDTH_STEPS: u32 = 40;

impl<M: Elasticity> Compound<M> {
    /// Creates the potential at prestretch λp.
    #[must_use]
    pub fn new(prestretch: f64, elasticity: M, dielectric: Decaying, electrode: Stiff) -> Self {
        Self {
            elasticity,
            dielectric,
            electrode,
            thickness: prestretch.powi(-6),
        }
    }
}

impl<M: Elasticity> Potential for Compound<M> {
    const SEVERAL_BRANCHES: bool = M::STIFFENS;

    #[inline(always)]
    fn energy<V: Value>(&self, at: &Invariants<V>, active: V) -> V {
        let electric = self.dielectric.energy(at) + self.electrode.energy(at);
        active.madd(electric, self.elasticity.energy(at))
    }

    #[inline(always)]
    fn slopes<V: Value>(&self, at: &Invariants<V>, active: V) -> Slopes<V> {
        let elastic = self.elasticity.slopes(at);
        let electric = self.dielectric.slopes(at) + self.electrode.slopes(at);
        elastic + electric.scaled(active)
    }

    fn rest(&self) -> Rest {
        self.elasticity.rest()
    }

    #[inline(always)]
    fn admissible<V: Value>(&self, at: &Invariants<V>) -> V {
        self.elasticity.admissible(at)
    }

    // They solve (m + χ)l₂ − (ma + χ)l₁⁻²l₂⁻³ = b l₁²l₂ with the moduli and the load at rest, which is exact where
    // these are constant. Without electrodes and voltage it is uniaxial tension, l₂⁴ = a/l₁², for any elastic law;
    // electrodes and voltage increase the width.
    #[inline(always)]
    fn natural_width<V: Value>(&self, first: V, active: V) -> [V; 2] {
        let number = |value: f64| active.constant(value);
        let coating = number(self.electrode.ratio) * active;
        let modulus = number(self.elasticity.rest().i);
        let resistance = number(self.thickness).madd(modulus, coating);
        let stiffness = modulus + coating - number(self.dielectric.load()) * active * first;
        // A stiffening modulus is larger than at rest.
        let least = number(if self.width_steps() == 0 {
            SMALLEST_STIFFNESS
        } else {
            0.1
        });
        let inverse = first.recip();
        let uniaxial = (number(self.thickness) * inverse).sqrt();
        [uniaxial, (resistance * (inverse * stiffness.max(least).recip())).sqrt()]
    }

    fn width_steps(&self) -> u32 {
        if M::STIFFENS || !self.dielectric.is_ideal() {
            WIDTH_STEPS
        } else {
            0
        }
    }

    fn load(&self) -> f64 {
        self.dielectric.load()
    }

    fn softening(&self) -> f64 {
        self.dielectric.softening()
    }
}

/// Lower bound of the stiffness across a strip: it gives a width far beyond any real one.
const SMALLEST_STIFFNESS: f64 = 1e-4;
