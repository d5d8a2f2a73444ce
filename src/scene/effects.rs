//! Effects beyond the base model. Each is off unless the scene names it.

use crate::base::{Decimal, Quantity};

/// The effects that a scene simulates.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Effects {
    /// The elastomer stiffens at large strains.
    pub strain_stiffening: Option<Stiffening>,
    /// The electrodes resist stretching.
    pub electrode_stiffness: Option<Electrode>,
    /// The permittivity falls as the membrane is stretched.
    pub stretch_dependent_permittivity: Option<PermittivityDecay>,
    /// The field bulges out at the edges of electrodes.
    pub fringe_field: bool,
    /// The membrane wrinkles instead of bearing compression.
    pub wrinkling: bool,
    /// The field is compared with the one at which the elastomer breaks down.
    pub dielectric_breakdown: Option<BreakdownLaw>,
    /// The smallest eigenvalue of the tangent and the margin to pull-in are computed.
    pub electromechanical_stability: bool,
}

impl Effects {
    /// Whether this is the base model.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// How the elastomer stiffens; the shear modulus μ is that of the material.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stiffening {
    /// W = −½μ Jm ln(1 − (I₁ − 3)/Jm) (Gent, Rubber Chem. Technol. 69 (1996) 59).
    Gent {
        /// Limit of I₁ − 3, without unit.
        jm: Decimal,
    },
    /// W = C₁(I₁ − 3) + C₂(I₁ − 3)² + C₃(I₁ − 3)³ with C₁ = ½μ (Yeoh, Rubber Chem. Technol. 66 (1993) 754).
    Yeoh {
        /// C₂ (stress).
        c2: Quantity,
        /// C₃ (stress).
        c3: Quantity,
    },
    /// W = Σ (μₚ/αₚ)(λ₁^αₚ + λ₂^αₚ + λ₃^αₚ − 3) with ½ Σ μₚαₚ = μ (Ogden, Proc. R. Soc. A 326 (1972) 565).
    Ogden {
        /// μₚ (stress) and αₚ (number), one to three terms.
        terms: Vec<(Quantity, Quantity)>,
    },
    /// Eight chains of limited extensibility (Arruda and Boyce, J. Mech. Phys. Solids 41 (1993) 389); μ is the modulus
    /// n k T of the network.
    ArrudaBoyce {
        /// λL, the stretch of a chain at which it locks.
        locking_stretch: Decimal,
    },
}

/// A layer of electrode on the prestretched membrane, free of stress when the membrane is at rest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Electrode {
    /// Shear modulus (stress).
    pub shear_modulus: Quantity,
    /// Thickness of both electrodes together, as applied to the prestretched membrane (length).
    pub thickness: Quantity,
}

/// ε ∝ J^(−s).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PermittivityDecay {
    /// s.
    pub exponent: Decimal,
    /// Where the permittivity of the material was measured.
    pub reference: PermittivityReference,
}

/// The state in which a permittivity was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PermittivityReference {
    /// On the prestretched membrane.
    Prestretched,
    /// On the undeformed elastomer.
    Undeformed,
}

/// The field at which the elastomer breaks down.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BreakdownLaw {
    /// E_B = 51 H^(−0.25) λ^(0.63) in MV/m, H in mm the undeformed thickness, λ the in-plane stretch of equal area
    /// (Huang, Shian, Diebold, Suo, Clarke, Appl. Phys. Lett. 101 (2012) 122905, for VHB 4905 and 4910).
    Huang,
    /// The same field everywhere (field, V/m).
    Constant(Quantity),
}
