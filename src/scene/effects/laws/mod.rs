//! Strain stiffening: the laws by which an elastomer stiffens at large strains, one per file, and the table of them.
//!
//! A law states its parameters, and its energy as one of the forms that kernels are compiled for. It
//! is normalised by the shear modulus μ of the material. A program may hand a law of its own to the solver.

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
    /// The energy, in a form that kernels are compiled for, at a shear modulus in Pa.
    fn form(&self, shear_modulus_pa: f64) -> Form;

    /// Refuses a law that contradicts the shear modulus of the material, in Pa; `node` is its mapping.
    ///
    /// # Errors
    /// When its small-strain shear modulus is another.
    fn check_modulus(&self, node: &Node, shear_modulus_pa: f64) -> Result<(), InputError> {
        let _ = (node, shear_modulus_pa);
        Ok(())
    }
}

/// Declares the table: the word after `model:`, and the parameters of the law.
macro_rules! laws {
    ($($word:literal => $law:ident),+ $(,)?) => {
        variants! {
            /// How the elastomer stiffens at large strains.
            pub enum Stiffening as "`strain_stiffening`" by "model" {
                $($word => $law($law)),+
            }
        }

        impl Stiffening {
            /// An example of each law, in YAML.
            pub const EXAMPLES: &'static [&'static str] = &[$($law::EXAMPLE),+];

            /// The law itself.
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
    "gent" => Gent,
    "yeoh" => Yeoh,
    "ogden" => Ogden,
    "arruda-boyce" => ArrudaBoyce,
    "mooney-rivlin" => MooneyRivlin,
}
