//! Effects beyond the base model. Each is off unless the scene names it.
//!
//! An effect is declared once, in [`Effects`]; its parameters stand in a file of their own. In a scene it is turned on by its parameters,
//! or by nothing, `true` or `{}`, which mean those that the section `properties` has for it.

mod breakdown;
mod electrode;
mod inertia;
pub mod laws;
mod permittivity;
mod resistance;
mod switch;
mod viscoelasticity;

pub use breakdown::{Breakdown, ConstantStrength, HuangStrength};
pub use electrode::Electrode;
pub use inertia::Inertia;
pub use laws::Stiffening;
pub use permittivity::{PermittivityDecay, PermittivityReference};
pub use resistance::ElectrodeResistance;
pub(super) use switch::switched_on;
pub(super) use viscoelasticity::MOST_BRANCHES;
pub use viscoelasticity::{Branch, Viscoelasticity, ViscousLaw};

use std::path::Path;

use deaflow_base::{Declared, Document, Fields, InputError, parameters};

parameters! {
    /// Effects beyond the base model; each is off unless it is named.
    #[derive(Default)]
    pub struct Effects as "`effects`" {
        /// The elastomer stiffens at large strains.
        pub strain_stiffening: Option<Stiffening>,
        /// The electrodes resist stretching.
        pub electrode_stiffness: Option<Electrode>,
        /// The permittivity falls as the membrane is stretched.
        pub stretch_dependent_permittivity: Option<PermittivityDecay>,
        /// The field bulges out at the edges of electrodes.
        pub fringe_field: Option<On>,
        /// The membrane wrinkles instead of bearing compression.
        pub wrinkling: Option<On>,
        /// The field is compared with the one at which the elastomer breaks down.
        pub dielectric_breakdown: Option<Breakdown>,
        /// The elastomer creeps: histories follow it, and solutions without a time are those in which it has relaxed.
        pub viscoelasticity: Option<Viscoelasticity>,
        /// The membrane has a mass: histories are motions, not equilibria.
        pub inertia: Option<Inertia>,
        /// The electrodes resist the current from the leads: histories follow how they charge, and equilibria are charged.
        pub electrode_resistance: Option<ElectrodeResistance>,
        /// The charge of the electrodes is given and their voltage found: on wherever the drive is a charge.
        pub charge_control: Option<On>,
        /// The smallest eigenvalue of the tangent and the margin to pull-in are computed.
        pub electromechanical_stability: Option<On>,
    }
    rules(switchable)
}

parameters! {
    /// No parameters.
    pub struct On as "this effect, which takes no parameters," {}
}

/// Each effect may also be turned on without parameters.
fn switchable(fields: Fields) -> Fields {
    fields.map_schemas(switch::schema)
}

impl Effects {
    /// Whether this is the base model.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The effects in YAML on one line.
    #[must_use]
    pub fn to_text(&self) -> String {
        self.to_canonical().to_string()
    }

    /// Reads what [`Effects::to_text`] writes.
    ///
    /// # Errors
    /// When the text does not name effects with their parameters.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        Self::read_with(&Document::from_text(Path::new("effects"), text)?.root, &[])
    }
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
    /// Rigid parts in the membrane: on wherever the geometry has bodies.
    pub const INCLUSION: &str = "rigid_inclusion";
}
