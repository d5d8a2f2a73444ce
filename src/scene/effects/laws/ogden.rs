//! Ogden's law in principal stretches (Proc. R. Soc. A 326 (1972) 565).
//!
//! W = Σ (μₚ/αₚ)(λ₁^αₚ + λ₂^αₚ + λ₃^αₚ − 3) with ½ Σ μₚαₚ = μ. Neo-Hookean with the single exponent 2.

use super::{Form, StiffeningLaw};
use deaflow_base::{Decimal, InputError, Map, Node, Stress, parameters};

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

impl OgdenTerm {
    fn is_regular(&self, map: &Map<'_>) -> Result<(), InputError> {
        match map.optional("alpha").filter(|_| self.alpha.to_f64().abs() < 1e-3) {
            Some(node) => Err(node.error("`alpha` is zero or nearly zero, which makes the term singular")),
            None => Ok(()),
        }
    }
}

impl StiffeningLaw for Ogden {
    fn form(&self, shear_modulus_pa: f64) -> Form {
        let term = |term: &OgdenTerm| (term.mu.value() / shear_modulus_pa, term.alpha.to_f64());
        Form::Stretches(self.terms.iter().map(term).collect())
    }

    /// Both moduli must agree within 1 %.
    fn check_modulus(&self, node: &Node, modulus: f64) -> Result<(), InputError> {
        let own: f64 = self
            .terms
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
                "the terms have the small-strain shear modulus ½ Σ mu alpha = {own:.6} Pa, but `shear_modulus` is \
                 {modulus} Pa"
            ))
            .help("they must agree within 1 %"))
    }

    fn has_moduli(&self) -> bool {
        true
    }
}
