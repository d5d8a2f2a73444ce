//! What is known of a material and its electrodes beyond the base model: what screening compares, and what effects that are
//! named without parameters of their own use.

use super::effects::{BreakdownLaw, Electrode, PermittivityDecay, Stiffening, names, parametric, present};
use crate::base::{Canonical, Quantity};

/// Known properties; what is not known is not screened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Properties {
    /// How the elastomer stiffens.
    pub strain_stiffening: Option<Stiffening>,
    /// The electrodes.
    pub electrode_stiffness: Option<Electrode>,
    /// How the permittivity depends on stretch.
    pub stretch_dependent_permittivity: Option<PermittivityDecay>,
    /// Where the elastomer breaks down.
    pub dielectric_breakdown: Option<BreakdownLaw>,
    /// Branches of a viscoelastic elastomer beside the equilibrium one.
    pub viscoelasticity: Vec<Branch>,
    /// Density of the elastomer (density).
    pub density: Option<Quantity>,
    /// Resistance of a square of electrode (resistance).
    pub sheet_resistance: Option<Quantity>,
}

/// A spring and a dashpot in series.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Branch {
    /// Shear modulus of the spring (stress).
    pub modulus: Quantity,
    /// Relaxation time (time).
    pub time: Quantity,
}

impl Properties {
    /// Whether nothing is known.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The properties as a canonical value; in flow style also their YAML.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        let branch = |branch: &Branch| {
            Canonical::map([
                ("modulus", Canonical::from(&branch.modulus)),
                ("time", (&branch.time).into()),
            ])
        };
        let branches = || self.viscoelasticity.iter().map(branch).collect();
        let parametric = parametric(
            self.strain_stiffening.as_ref(),
            self.electrode_stiffness.as_ref(),
            self.stretch_dependent_permittivity.as_ref(),
            self.dielectric_breakdown.as_ref(),
        );
        present(parametric.into_iter().chain([
            (
                names::VISCOELASTICITY,
                (!self.viscoelasticity.is_empty()).then(branches),
            ),
            ("density", self.density.as_ref().map(Canonical::from)),
            ("sheet_resistance", self.sheet_resistance.as_ref().map(Canonical::from)),
        ]))
    }
}
