//! Effects beyond the base model. Each is off unless the scene names it.

use crate::base::{Canonical, Decimal, Quantity};

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

    /// The effects as a canonical value; in flow style also their YAML.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        let plain = |on: bool| on.then(|| Canonical::map::<String>([]));
        let parametric = parametric(
            self.strain_stiffening.as_ref(),
            self.electrode_stiffness.as_ref(),
            self.stretch_dependent_permittivity.as_ref(),
            self.dielectric_breakdown.as_ref(),
        );
        present(parametric.into_iter().chain([
            (names::FRINGE, plain(self.fringe_field)),
            (names::WRINKLING, plain(self.wrinkling)),
            (names::STABILITY, plain(self.electromechanical_stability)),
        ]))
    }
}

/// The entries of effects with parameters, which stand alike among effects and properties.
pub(super) fn parametric(
    stiffening: Option<&Stiffening>,
    electrode: Option<&Electrode>,
    permittivity: Option<&PermittivityDecay>,
    breakdown: Option<&BreakdownLaw>,
) -> [(&'static str, Option<Canonical>); 4] {
    [
        (names::STIFFENING, stiffening.map(Stiffening::canonical)),
        (names::ELECTRODE, electrode.map(Electrode::canonical)),
        (names::PERMITTIVITY, permittivity.map(PermittivityDecay::canonical)),
        (names::BREAKDOWN, breakdown.map(BreakdownLaw::canonical)),
    ]
}

/// The entries that have a value.
pub(super) fn present(entries: impl Iterator<Item = (&'static str, Option<Canonical>)>) -> Canonical {
    Canonical::map(entries.filter_map(|(name, value)| Some((name, value?))))
}

/// The words for effects in a scene.
pub mod names {
    /// Strain stiffening.
    pub const STIFFENING: &str = "strain_stiffening";
    /// Electrode stiffness.
    pub const ELECTRODE: &str = "electrode_stiffness";
    /// Stretch-dependent permittivity.
    pub const PERMITTIVITY: &str = "stretch_dependent_permittivity";
    /// Fringe field.
    pub const FRINGE: &str = "fringe_field";
    /// Wrinkling.
    pub const WRINKLING: &str = "wrinkling";
    /// Dielectric breakdown.
    pub const BREAKDOWN: &str = "dielectric_breakdown";
    /// Electromechanical stability.
    pub const STABILITY: &str = "electromechanical_stability";
    /// Finite viscoelasticity.
    pub const VISCOELASTICITY: &str = "viscoelasticity";
    /// Inertia.
    pub const INERTIA: &str = "inertia";
    /// Resistance of the electrodes.
    pub const RESISTANCE: &str = "electrode_resistance";
    /// A charge drives, not a voltage.
    pub const CHARGE: &str = "charge_control";
    /// A rigid part on the membrane.
    pub const INCLUSION: &str = "rigid_inclusion";

    /// Effects that can be simulated.
    pub const AVAILABLE: [&str; 7] = [
        STIFFENING,
        ELECTRODE,
        PERMITTIVITY,
        FRINGE,
        WRINKLING,
        BREAKDOWN,
        STABILITY,
    ];
    /// Effects that are known and cannot be simulated yet.
    pub const PLANNED: [&str; 5] = [VISCOELASTICITY, INERTIA, RESISTANCE, CHARGE, INCLUSION];
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

impl Stiffening {
    /// The word after `model:`.
    #[must_use]
    pub fn model(&self) -> &'static str {
        match self {
            Self::Gent { .. } => "gent",
            Self::Yeoh { .. } => "yeoh",
            Self::Ogden { .. } => "ogden",
            Self::ArrudaBoyce { .. } => "arruda-boyce",
        }
    }

    fn canonical(&self) -> Canonical {
        let model = ("model", Canonical::from(self.model()));
        match self {
            Self::Gent { jm } => Canonical::map([model, ("jm", (*jm).into())]),
            Self::Yeoh { c2, c3 } => Canonical::map([model, ("c2", c2.into()), ("c3", c3.into())]),
            Self::Ogden { terms } => {
                let term = |(mu, alpha): &(Quantity, Quantity)| {
                    Canonical::map([("mu", Canonical::from(mu)), ("alpha", alpha.into())])
                };
                Canonical::map([model, ("terms", terms.iter().map(term).collect())])
            }
            Self::ArrudaBoyce { locking_stretch } => {
                Canonical::map([model, ("locking_stretch", (*locking_stretch).into())])
            }
        }
    }
}

/// A layer of electrode on the prestretched membrane, free of stress when the membrane is at rest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Electrode {
    /// Shear modulus (stress).
    pub shear_modulus: Quantity,
    /// Thickness of both electrodes together, as applied to the prestretched membrane (length).
    pub thickness: Quantity,
}

impl Electrode {
    fn canonical(&self) -> Canonical {
        Canonical::map([
            ("shear_modulus", Canonical::from(&self.shear_modulus)),
            ("thickness", (&self.thickness).into()),
        ])
    }
}

/// ε ∝ J^(−s).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PermittivityDecay {
    /// s.
    pub exponent: Decimal,
    /// Where the permittivity of the material was measured.
    pub reference: PermittivityReference,
}

impl PermittivityDecay {
    fn canonical(&self) -> Canonical {
        Canonical::map([
            ("exponent", Canonical::from(self.exponent)),
            ("reference", self.reference.name().into()),
        ])
    }
}

/// The state in which a permittivity was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PermittivityReference {
    /// On the prestretched membrane.
    Prestretched,
    /// On the undeformed elastomer.
    Undeformed,
}

impl PermittivityReference {
    /// The word after `reference:`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Prestretched => "prestretched",
            Self::Undeformed => "undeformed",
        }
    }
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

impl BreakdownLaw {
    fn canonical(&self) -> Canonical {
        match self {
            Self::Huang => Canonical::map([("law", Canonical::from("huang"))]),
            Self::Constant(field) => Canonical::map([("law", Canonical::from("constant")), ("field", field.into())]),
        }
    }

    /// The field at which a membrane of an undeformed thickness in mm breaks down at an area stretch J, in V/m.
    #[must_use]
    pub fn field(&self, thickness_mm: f64, area_stretch: f64) -> f64 {
        match self {
            Self::Huang => 51e6 * thickness_mm.powf(-0.25) * area_stretch.powf(0.315),
            Self::Constant(field) => field.value(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn breakdown_follows_the_published_law() {
        // 51 · 0.5^(−0.25) · 5^0.63 MV/m = 51 · 1.189207 · 2.756456
        let field = BreakdownLaw::Huang.field(0.5, 25.0);
        assert!((field / 167.177_866e6 - 1.0).abs() < 1e-8, "{field}");
    }
}
