//! Gent's law of limited extensibility (Rubber Chem. Technol. 69 (1996) 59).
//!
//! W = −½μ Jm ln(1 − (I₁ − 3)/Jm), so 2ψ′/μ = 1/(1 − (I₁ − 3)/Jm). Neo-Hookean as Jm → ∞.

use super::{Form, Response, StiffeningLaw};
use deaflow_base::{Decimal, parameters};

parameters! {
    /// W = −½μ Jm ln(1 − (I1 − 3)/Jm) (Gent, Rubber Chem. Technol. 69 (1996) 59).
    pub struct Gent as "a gent model" {
        /// Limit of I1 − 3.
        pub jm: Decimal [1e-3..=1e12],
    }
}

impl StiffeningLaw for Gent {
    fn form(&self, _shear_modulus_pa: f64) -> Form {
        Form::FirstInvariant(Response {
            polynomial: [0.0; 3],
            pole: 1.0,
            origin: 3.0,
            scale: self.jm.to_f64(),
        })
    }
}
