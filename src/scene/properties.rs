//! What is known of a material and its electrodes beyond the base model: what screening compares, and what effects that are named without
//! parameters of their own use.

use super::effects::{Breakdown, Electrode, PermittivityDecay, Stiffening};
use crate::base::{Density, Resistance, Stress, Time, parameters};

parameters! {
    /// What is known beyond the base model: for screening, and for effects without parameters of their own. What is not known is not screened.
    #[derive(Default)]
    pub struct Properties as "`properties`" {
        /// How the elastomer stiffens.
        pub strain_stiffening: Option<Stiffening>,
        /// The electrodes.
        pub electrode_stiffness: Option<Electrode>,
        /// How the permittivity depends on stretch.
        pub stretch_dependent_permittivity: Option<PermittivityDecay>,
        /// Where the elastomer breaks down.
        pub dielectric_breakdown: Option<Breakdown>,
        /// Branches of a viscoelastic elastomer beside the equilibrium one.
        pub viscoelasticity: Option<Vec<Branch>> [((), 0..=usize::MAX)],
        /// Density of the elastomer.
        pub density: Option<Density> [1.0..=1e5],
        /// Resistance of a square of electrode.
        pub sheet_resistance: Option<Resistance> [0.0..=1e15],
    }
}

parameters! {
    /// A spring and a dashpot in series.
    pub struct Branch as "a branch" {
        /// Shear modulus of the spring.
        pub modulus: Stress [0.0..=1e12],
        /// Relaxation time.
        pub time: Time [1e-12..=1e12],
    }
}

impl Properties {
    /// Whether nothing is known.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
