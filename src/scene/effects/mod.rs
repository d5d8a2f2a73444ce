//! Effects beyond the base model. Each is off unless the scene names it.
//!
//! An effect is declared once, in [`Effects`]; its parameters are in a file of their own. A scene switches it on by its
//! parameters, or by nothing, `true` or `{}`, which stand for the parameters in the section `properties`.

mod breakdown;
mod electrode;
mod inertia;
pub mod laws;
mod permittivity;
mod properties;
mod resistance;
mod switch;
mod viscoelasticity;

pub use breakdown::{Breakdown, ConstantStrength, HuangStrength};
pub use electrode::Electrode;
pub use inertia::Inertia;
pub use laws::Stiffening;
pub use permittivity::{PermittivityDecay, PermittivityReference};
pub use properties::Properties;
pub use resistance::ElectrodeResistance;
pub(super) use switch::switched_on;
pub use viscoelasticity::{Branch, Viscoelasticity, ViscousLaw};

use std::path::Path;

use deaflow_base::{Declared, Document, Fields, InputError, parameters};

/// The word for `effects` that lets screening choose them.
pub const AUTO: &str = "auto";

parameters! {
    /// Effects beyond the base model; each is off unless it is named.
    #[derive(Default)]
    pub struct Effects as "`effects`" {
        /// The elastomer stiffens at large strains.
        pub strain_stiffening: Option<Stiffening>,
        /// The electrodes resist stretching.
        pub electrode_stiffness: Option<Electrode>,
        /// The permittivity decreases with stretch.
        pub stretch_dependent_permittivity: Option<PermittivityDecay>,
        /// The field spreads beyond the edges of electrodes.
        pub fringe_field: Option<On>,
        /// The membrane wrinkles under compression.
        pub wrinkling: Option<On>,
        /// The field is compared with the breakdown strength of the elastomer.
        pub dielectric_breakdown: Option<Breakdown>,
        /// The elastomer creeps. Histories follow it; solutions without a time are fully relaxed.
        pub viscoelasticity: Option<Viscoelasticity>,
        /// The membrane has a mass: histories are motions, not sequences of equilibria.
        pub inertia: Option<Inertia>,
        /// The electrodes have a resistance: histories follow their charging; in equilibrium they are charged.
        pub electrode_resistance: Option<ElectrodeResistance>,
        /// The charge of the electrodes is given and the voltage is computed; on if the drive is a charge.
        pub charge_control: Option<On>,
        /// Computes the smallest eigenvalue of the tangent and the margin to pull-in.
        pub electromechanical_stability: Option<On>,
    }
    rules(switchable)
}

parameters! {
    /// No parameters.
    pub struct On as "this effect, which takes no parameters," {}
}

/// Allows to switch each effect on without parameters.
fn switchable(fields: Fields) -> Fields {
    fields.map_schemas(switch::schema)
}

impl Effects {
    /// Returns whether no effect is on.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Returns the effects in YAML on one line.
    #[must_use]
    pub fn to_text(&self) -> String {
        self.to_canonical().to_string()
    }

    /// Reads the text of [`Effects::to_text`].
    ///
    /// # Errors
    /// When the text is not valid.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        Self::read_with(&Document::from_text(Path::new("effects"), text)?.root, &[])
    }
}

/// The names of effects in a scene.
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
    /// Charge control.
    pub const CHARGE: &str = "charge_control";
    /// Rigid bodies in the membrane; on if the geometry has bodies.
    pub const INCLUSION: &str = "rigid_inclusion";
}
