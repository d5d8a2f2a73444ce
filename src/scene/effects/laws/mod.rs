//! Strain stiffening: the laws by which an elastomer stiffens at large strains, one per file, and their table.
//!
//! A law declares its parameters, and states its energy as one of the forms for which kernels are compiled, normalised
//! by the shear modulus μ of the material. A program can pass a law of its own to the solver.

mod arruda_boyce;
mod form;
mod gent;
mod mooney_rivlin;
mod ogden;
mod yeoh;

pub use arruda_boyce::ArrudaBoyce;
pub use form::{Form, Response};
pub use gent::Gent;
pub use mooney_rivlin::MooneyRivlin;
pub use ogden::{Ogden, OgdenTerm};
pub use yeoh::Yeoh;

use deaflow_base::{InputError, Node, variants};

/// A law by which an elastomer stiffens.
pub trait StiffeningLaw {
    /// Returns the energy for a shear modulus in Pa.
    fn form(&self, shear_modulus_pa: f64) -> Form;

    /// Checks the law against the shear modulus of the material in Pa; `node` is the mapping of the law.
    ///
    /// # Errors
    /// When the small-strain shear modulus of the law differs.
    fn check_modulus(&self, _node: &Node, _shear_modulus_pa: f64) -> Result<(), InputError> {
        Ok(())
    }

    /// Returns whether it has all moduli itself, so that the shear modulus changes nothing.
    fn has_moduli(&self) -> bool {
        false
    }
}

/// Declares the table: the word after `model:`, the parameters of the law, and an example in YAML.
macro_rules! laws {
    ($($word:literal => $law:ident, $example:literal;)+) => {
        variants! {
            /// How the elastomer stiffens at large strains.
            pub enum Stiffening as "`strain_stiffening`" by "model" {
                $($word => $law($law)),+
            }
        }

        impl Stiffening {
            /// An example of each law, in YAML.
            pub const EXAMPLES: &'static [&'static str] = &[$($example),+];

            /// Returns the law.
            #[must_use]
            pub fn law(&self) -> &dyn StiffeningLaw {
                match self {
                    $(Self::$law(law) => law),+
                }
            }
        }
    };
}

laws! {
    "gent" => Gent, "{ model: gent, jm: 125 }";
    "yeoh" => Yeoh, "{ model: yeoh, c2: -150 Pa, c3: 4 Pa }";
    "ogden" => Ogden, "{ model: ogden, terms: [ { mu: 45 kPa, alpha: 2 } ] }";
    "arruda-boyce" => ArrudaBoyce, "{ model: arruda-boyce, locking_stretch: 4 }";
    "mooney-rivlin" => MooneyRivlin, "{ model: mooney-rivlin, c2: 500 Pa }";
}
