//! The law of Mooney (J. Appl. Phys. 11 (1940) 582) and Rivlin (Phil. Trans. R. Soc. A 241 (1948) 379).
//!
//! W = C₁(I₁ − 3) + C₂(I₂ − 3) with C₁ + C₂ = ½μ, so 2ψ′/μ = 1 − 2C₂/μ with (C₂/μ)(I₂ − 3) beside it. Neo-Hookean where
//! C₂ is zero. Under equibiaxial stress σ = 2(λ² − λ⁻⁴)(C₁ + C₂λ²): a positive C₂ stiffens what is stretched in both
//! directions.

use super::{Form, Response, StiffeningLaw};
use deaflow_base::{Stress, parameters};

parameters! {
    /// W = C1(I1 − 3) + C2(I2 − 3) with C1 + C2 = ½μ (Mooney, J. Appl. Phys. 11 (1940) 582; Rivlin, Phil. Trans. R.
    /// Soc. A 241 (1948) 379).
    pub struct MooneyRivlin as "a mooney-rivlin model" {
        /// C2.
        pub c2: Stress [-1e9..=1e9],
    }
}

impl StiffeningLaw for MooneyRivlin {
    fn form(&self, shear_modulus_pa: f64) -> Form {
        let second = self.c2.value() / shear_modulus_pa;
        Form::BothInvariants(Response::polynomial([1.0 - 2.0 * second, 0.0, 0.0]), second)
    }
}
