//! The materials of scenes: an elastomer that is a dielectric, with electrodes and wrinkles, at a load.
//!
//! Only here the types of materials are composed and erased. So their kernels are compiled with this crate, and neither
//! again with the solvers nor with their tests.

use crate::energy::{Compound, Decaying, Elasticity, Isotropic, NeoHookean, NeoHookeanEnergy};
use crate::energy::{Stiff, Stiffened, TensionField};
use crate::material::AnyMaterial;
use deaflow_scene::PermittivityDecay;

/// What a material consists of, at any load.
#[derive(Clone, Debug)]
pub struct Composition {
    /// λp, equal along x and y; with unequal prestretch √(λ₁λ₂).
    pub prestretch: f64,
    /// The energy of an elastomer that stiffens; without it is neo-Hookean.
    pub stiffening: Option<Stiffened>,
    /// Electrodes with stiffness.
    pub electrode: Option<Stiff>,
    /// A permittivity that depends on the stretch.
    pub decay: Option<PermittivityDecay>,
    /// Whether the membrane wrinkles instead of bearing compression.
    pub wrinkles: bool,
}

impl Composition {
    /// Returns whether it is the base model: no effect changes the energy at a point.
    #[must_use]
    pub fn is_base(&self) -> bool {
        self.stiffening.is_none() && self.electrode.is_none() && self.decay.is_none() && !self.wrinkles
    }

    /// Returns the material at κ. The base model includes branches of a modulus γ, in units of μλp², that have no time
    /// to relax; others need `gamma` = 0.
    #[must_use]
    pub fn material(&self, kappa: f64, gamma: f64) -> AnyMaterial {
        match self.stiffening {
            None if self.is_base() => AnyMaterial::new(NeoHookean::new(self.prestretch, kappa).with_unrelaxed(gamma)),
            None => self.with_elasticity(NeoHookeanEnergy::new(self.prestretch), kappa),
            Some(elasticity) => self.with_elasticity(elasticity, kappa),
        }
    }

    fn with_elasticity(&self, elasticity: impl Elasticity, kappa: f64) -> AnyMaterial {
        let electrode = self.electrode.unwrap_or(Stiff { ratio: 0.0 });
        let dielectric = match &self.decay {
            None => Decaying::ideal(self.prestretch, kappa),
            Some(decay) => Decaying::new(decay, self.prestretch, kappa),
        };
        let potential = Compound::new(self.prestretch, elasticity, dielectric, electrode);
        if self.wrinkles {
            AnyMaterial::new(Isotropic::new(TensionField::new(potential)))
        } else {
            AnyMaterial::new(Isotropic::new(potential))
        }
    }
}
