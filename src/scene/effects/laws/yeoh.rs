//! Yeoh's cubic law (Rubber Chem. Technol. 66 (1993) 754).
//!
//! W = ½μ(I₁ − 3) + C₂(I₁ − 3)² + C₃(I₁ − 3)³, so 2ψ′/μ = 1 + 4(C₂/μ)(I₁ − 3) + 6(C₃/μ)(I₁ − 3)². Neo-Hookean where
//! both are zero.

use super::{Form, Response, StiffeningLaw};
use deaflow_base::{Stress, parameters};

parameters! {
    /// W = C1(I1 − 3) + C2(I1 − 3)² + C3(I1 − 3)³ with C1 = ½μ (Yeoh, Rubber Chem. Technol. 66 (1993) 754).
    pub struct Yeoh as "a yeoh model" {
        /// C2.
        pub c2: Stress [-1e9..=1e9],
        /// C3.
        pub c3: Stress [-1e9..=1e9],
    }
}

impl StiffeningLaw for Yeoh {
    fn form(&self, shear_modulus_pa: f64) -> Form {
        let [second, third] = [self.c2, self.c3].map(|c| c.value() / shear_modulus_pa);
        Form::FirstInvariant(Response::polynomial([1.0, 4.0 * second, 6.0 * third]))
    }
}
