//! Strain stiffening: the laws by which the elastomer stiffens at large strains. The shear modulus μ is that of the material.

use crate::base::{Decimal, InputError, Map, Node, Stress, parameters, variants};

variants! {
    /// How the elastomer stiffens at large strains.
    pub enum Stiffening as "`strain_stiffening`" by "model" {
        "gent" => Gent(Gent),
        "yeoh" => Yeoh(Yeoh),
        "ogden" => Ogden(Ogden),
        "arruda-boyce" => ArrudaBoyce(ArrudaBoyce),
    }
}

parameters! {
    /// W = −½μ Jm ln(1 − (I1 − 3)/Jm) (Gent, Rubber Chem. Technol. 69 (1996) 59).
    pub struct Gent as "a gent model" {
        /// Limit of I1 − 3.
        pub jm: Decimal [1e-3..=1e12],
    }
}

parameters! {
    /// W = C1(I1 − 3) + C2(I1 − 3)² + C3(I1 − 3)³ with C1 = ½μ (Yeoh, Rubber Chem. Technol. 66 (1993) 754).
    pub struct Yeoh as "a yeoh model" {
        /// C2.
        pub c2: Stress [-1e9..=1e9],
        /// C3.
        pub c3: Stress [-1e9..=1e9],
    }
}

parameters! {
    /// W = Σ (mu/alpha)(λ1^alpha + λ2^alpha + λ3^alpha − 3) (Ogden, Proc. R. Soc. A 326 (1972) 565).
    pub struct Ogden as "an ogden model" {
        /// One to three terms; half of the sum of mu · alpha is the shear modulus.
        pub terms: Vec<OgdenTerm> [((), 1..=3)],
    }
}

parameters! {
    /// A term of Ogden's model.
    pub struct OgdenTerm as "a term" {
        /// Modulus.
        pub mu: Stress [-1e9..=1e9],
        /// Exponent; not zero.
        pub alpha: Decimal [-15.0..=15.0],
    }
    check(OgdenTerm::is_regular)
}

parameters! {
    /// Eight chains of limited extensibility (Arruda and Boyce, J. Mech. Phys. Solids 41 (1993) 389); μ is the modulus n k T of the network.
    pub struct ArrudaBoyce as "an arruda-boyce model" {
        /// Stretch of a chain at which it locks.
        pub locking_stretch: Decimal [1.0..=1e6],
    }
}

impl OgdenTerm {
    fn is_regular(&self, map: &Map<'_>) -> Result<(), InputError> {
        match map.optional("alpha").filter(|_| self.alpha.to_f64().abs() < 1e-3) {
            Some(node) => Err(node.error("`alpha` is zero or nearly so: the term would be singular")),
            None => Ok(()),
        }
    }
}

impl Stiffening {
    /// Refuses a law whose small-strain shear modulus is not that of the material, in Pa, within 1 %.
    ///
    /// # Errors
    /// When it is another.
    pub(in crate::scene) fn check_modulus(&self, node: &Node, modulus: f64) -> Result<(), InputError> {
        let Self::Ogden(Ogden { terms }) = self else {
            return Ok(());
        };
        let own: f64 = terms
            .iter()
            .map(|term| 0.5 * term.mu.value() * term.alpha.to_f64())
            .sum();
        if (own / modulus - 1.0).abs() <= 1e-2 {
            return Ok(());
        }
        Err(node
            .peek("terms")
            .unwrap_or(node)
            .error(format!(
                "the terms have the small-strain shear modulus ½ Σ mu alpha = {own:.6} Pa, but `shear_modulus` is {modulus} Pa"
            ))
            .help("the two must agree to 1 %"))
    }
}
