//! Stretch-dependent permittivity: ε(J) = ε J^(−s).
//!
//! At a given voltage the electric energy per undeformed volume is −½ ε(J)(V/H)²J² (Zhao and Suo, J. Appl. Phys. 104
//! (2008) 123530, for deformation-dependent permittivity), so per prestretched area and in units of μH it is −½ b jⁿ
//! with n = 2 − s. If ε was measured on the undeformed elastomer, J = λp²j gives b = κλp²·λp^(−2s); on the prestretched
//! membrane, J is relative to it and b = κλp². The effect vanishes as s → 0.

use super::potential::{Invariants, Slopes};
use crate::lanes::Value;
use crate::powers::power_minus_one;
use deaflow_scene::{PermittivityDecay, PermittivityReference};

/// A dielectric whose permittivity decreases with the stretch, or an ideal one with s = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decaying {
    /// b.
    pub pull: f64,
    /// s.
    pub exponent: f64,
}

impl Decaying {
    /// Creates the ideal dielectric at prestretch λp and κ.
    #[must_use]
    pub fn ideal(prestretch: f64, kappa: f64) -> Self {
        Self {
            pull: kappa * prestretch * prestretch,
            exponent: 0.0,
        }
    }

    /// Creates the dielectric at prestretch λp and κ.
    #[must_use]
    pub fn new(decay: &PermittivityDecay, prestretch: f64, kappa: f64) -> Self {
        let exponent = decay.exponent.to_f64();
        let reference = match decay.reference {
            PermittivityReference::Prestretched => 1.0,
            PermittivityReference::Undeformed => prestretch.powf(-2.0 * exponent),
        };
        Self {
            pull: kappa * prestretch * prestretch * reference,
            exponent,
        }
    }

    /// Returns whether the permittivity is constant.
    #[must_use]
    pub fn is_ideal(&self) -> bool {
        self.exponent == 0.0
    }

    /// Returns b j^(−s).
    #[inline(always)]
    fn pull<V: Value>(&self, at: &Invariants<V>) -> V {
        let pull = at.area.constant(self.pull);
        if self.is_ideal() {
            return pull;
        }
        pull.madd(power_minus_one(at.dilation, -self.exponent), pull)
    }

    /// Returns φ of an active point.
    #[inline(always)]
    pub fn energy<V: Value>(&self, at: &Invariants<V>) -> V {
        at.area.constant(-0.5) * self.pull(at) * at.area * at.area
    }

    /// Returns the derivatives of φ of an active point.
    #[inline(always)]
    pub fn slopes<V: Value>(&self, at: &Invariants<V>) -> Slopes<V> {
        let n = 2.0 - self.exponent;
        let pull = at.area.constant(-0.5 * n) * self.pull(at);
        Slopes::of_area(pull * at.area, at.area.constant(n - 1.0) * pull)
    }

    /// Returns −φⱼ at rest.
    #[must_use]
    pub fn load(&self) -> f64 {
        0.5 * (2.0 - self.exponent) * self.pull
    }

    /// Returns −φⱼⱼ at rest, in units of the load.
    #[must_use]
    pub fn softening(&self) -> f64 {
        1.0 - self.exponent
    }
}
