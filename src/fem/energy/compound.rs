//! A potential put together: an elastomer, the dielectric that it is, and electrodes.

use super::elasticity::Elastic;
use super::potential::{Invariants, Potential, Rest, Slopes};
use crate::effects::{Decaying, Stiff};
use crate::lanes::Value;

/// Elastomer, dielectric and electrodes at a prestretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compound {
    elasticity: Elastic,
    dielectric: Decaying,
    electrode: Stiff,
    /// a = λp⁻⁶.
    thickness: f64,
}

/// Newton steps to a natural width that no formula gives; three or four are usual.
const WIDTH_STEPS: u32 = 40;

impl Compound {
    /// The potential at prestretch λp.
    #[must_use]
    pub fn new(prestretch: f64, elasticity: Elastic, dielectric: Decaying, electrode: Stiff) -> Self {
        Self {
            elasticity,
            dielectric,
            electrode,
            thickness: prestretch.powi(-6),
        }
    }

    /// The square of the natural width, the l₂ at which a strip of squared stretch l₁² has no stress across: a lower bound and an estimate.
    ///
    /// From (m + χ)l₂ − (ma + χ)l₁⁻²l₂⁻³ = b l₁²l₂ with the moduli and the load at rest: exact where they are constant.
    /// Without electrodes and voltage it is uniaxial tension whatever the elastic law, l₂⁴ = a/l₁²; both make it wider.
    #[inline(always)]
    pub fn natural_width<V: Value>(&self, first: V, active: V) -> [V; 2] {
        let number = |value: f64| active.constant(value);
        let coating = number(self.electrode.ratio) * active;
        let modulus = number(self.elasticity.rest().i);
        let resistance = number(self.thickness).madd(modulus, coating);
        let room = modulus + coating - number(self.dielectric.load()) * active * first;
        // A modulus that grows leaves more room.
        let least = number(if self.width_steps() == 0 { SMALLEST_ROOM } else { 0.1 });
        let inverse = first.recip();
        let uniaxial = (number(self.thickness) * inverse).sqrt();
        [uniaxial, (resistance * (inverse * room.max(least).recip())).sqrt()]
    }

    /// Newton steps from the estimate to the natural width at most; none where it is exact.
    #[must_use]
    pub fn width_steps(&self) -> u32 {
        if self.elasticity.stiffens() || !self.dielectric.is_ideal() {
            WIDTH_STEPS
        } else {
            0
        }
    }
}

impl Potential for Compound {
    fn has_several_branches(&self) -> bool {
        self.elasticity.stiffens()
    }

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

    fn load(&self) -> f64 {
        self.dielectric.load()
    }

    fn softening(&self) -> f64 {
        self.dielectric.softening()
    }
}

/// What is left of the stiffness across a strip where none is: a width far beyond any real one.
const SMALLEST_ROOM: f64 = 1e-4;
