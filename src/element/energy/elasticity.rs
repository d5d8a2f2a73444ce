//! Elastic energies in units of μH per prestretched area: neo-Hookean, or with stiffening.

use super::first_invariant::FirstInvariant;
use super::ogden::{MOST_TERMS, Ogden};
use super::potential::{Invariants, Rest, Slopes};
use super::second_invariant::SecondInvariant;
use crate::error::SetupError;
use crate::lanes::Value;
use deaflow_scene::laws::Form;

/// An elastic energy per prestretched area, in units of μH.
pub trait Elasticity: Sync + Copy + 'static {
    /// Whether it stiffens, so that a membrane can be stable again after a snap.
    const STIFFENS: bool;

    /// Returns φ.
    fn energy<V: Value>(&self, at: &Invariants<V>) -> V;
    /// Returns the derivatives of φ.
    fn slopes<V: Value>(&self, at: &Invariants<V>) -> Slopes<V>;
    /// Returns the derivatives at rest.
    fn rest(&self) -> Rest;
    /// Returns a number that is positive where φ is finite.
    #[inline(always)]
    fn admissible<V: Value>(&self, at: &Invariants<V>) -> V {
        at.area
    }
}

/// ½(i + a j⁻² − 3/λp²): the elastic part of [`super::NeoHookean`], to be combined with effects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeoHookeanEnergy {
    /// a = λp⁻⁶.
    thickness: f64,
}

impl NeoHookeanEnergy {
    /// Creates the energy at prestretch λp.
    #[must_use]
    pub fn new(prestretch: f64) -> Self {
        Self {
            thickness: prestretch.powi(-6),
        }
    }
}

impl Elasticity for NeoHookeanEnergy {
    const STIFFENS: bool = false;

    #[inline(always)]
    fn energy<V: Value>(&self, at: &Invariants<V>) -> V {
        let a = at.area.constant(self.thickness);
        let rest = at.area.constant(2.0 - 3.0 * self.thickness.cbrt());
        at.area.constant(0.5) * (at.growth() + rest + a * at.inverse * at.inverse)
    }

    #[inline(always)]
    fn slopes<V: Value>(&self, at: &Invariants<V>) -> Slopes<V> {
        let cubic = at.area.constant(self.thickness) * at.inverse * (at.inverse * at.inverse);
        let first = cubic * at.cube_minus_one();
        Slopes {
            i: at.area.constant(1.0),
            ..Slopes::of_area(first, at.area.constant(3.0) * at.inverse * cubic)
        }
    }

    fn rest(&self) -> Rest {
        Rest {
            i: 1.0,
            j: -self.thickness,
        }
    }
}

/// An elastic energy with stiffening, of any form. A single type, so that kernels are compiled once; the branch is the
/// same at all points.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "created once per load step and read at every point, so no indirection"
)]
pub enum Stiffened {
    /// Gent, Yeoh, Arruda–Boyce.
    FirstInvariant(FirstInvariant),
    /// With a term in the second invariant.
    BothInvariants(FirstInvariant, SecondInvariant),
    /// Ogden.
    Stretches(Ogden),
}

impl Stiffened {
    /// Creates the energy of a form at prestretch λp.
    ///
    /// # Errors
    /// If the prestretch exceeds the limiting stretch, or the number or exponents of terms are invalid.
    pub fn new(form: &Form, prestretch: f64) -> Result<Self, SetupError> {
        let limited =
            |response| FirstInvariant::new(response, prestretch).ok_or(SetupError::LimitingStretch { prestretch });
        match form {
            Form::FirstInvariant(response) => limited(*response).map(Self::FirstInvariant),
            Form::BothInvariants(response, second) => Ok(Self::BothInvariants(
                limited(*response)?,
                SecondInvariant::new(*second, prestretch),
            )),
            Form::Stretches(terms) => {
                let is_valid_count = (1..=MOST_TERMS).contains(&terms.len());
                if is_valid_count && terms.iter().all(|(_, exponent)| *exponent != 0.0) {
                    Ok(Self::Stretches(Ogden::new(terms, prestretch)))
                } else {
                    Err(SetupError::OgdenTerms)
                }
            }
        }
    }
}

impl Elasticity for Stiffened {
    const STIFFENS: bool = true;

    #[inline(always)]
    fn energy<V: Value>(&self, at: &Invariants<V>) -> V {
        match self {
            Self::FirstInvariant(energy) => energy.energy(at),
            Self::BothInvariants(first, second) => first.energy(at) + second.energy(at),
            Self::Stretches(energy) => energy.energy(at),
        }
    }

    #[inline(always)]
    fn slopes<V: Value>(&self, at: &Invariants<V>) -> Slopes<V> {
        match self {
            Self::FirstInvariant(energy) => energy.slopes(at),
            Self::BothInvariants(first, second) => first.slopes(at) + second.slopes(at),
            Self::Stretches(energy) => energy.slopes(at),
        }
    }

    fn rest(&self) -> Rest {
        match self {
            Self::FirstInvariant(energy) => energy.rest(),
            Self::BothInvariants(first, second) => first.rest() + second.rest(),
            Self::Stretches(energy) => energy.rest(),
        }
    }

    #[inline(always)]
    fn admissible<V: Value>(&self, at: &Invariants<V>) -> V {
        match self {
            Self::FirstInvariant(energy) | Self::BothInvariants(energy, _) => energy.admissible(at),
            Self::Stretches(_) => at.area,
        }
    }
}
