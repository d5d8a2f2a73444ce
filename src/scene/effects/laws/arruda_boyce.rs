//! The eight-chain law (Arruda and Boyce, J. Mech. Phys. Solids 41 (1993) 389).
//!
//! With μ = nkT, locking stretch λL and y = √(I₁/3)/λL, 2ψ′/μ = 𝓛⁻¹(y)/(3y), where 𝓛⁻¹ inverts 𝓛(x) = coth x − 1/x.
//! Kröger's approximant (J. Non-Newtonian Fluid Mech. 223 (2015) 77), 𝓛⁻¹(y) ≈ (3y − (y/5)(6y² + y⁴ − 2y⁶))/(1 − y²),
//! is within 3e-3 of it; with Y = y² it gives
//!
//! ```text
//! 2ψ′/μ = [1 − (6Y + Y² − 2Y³)/15]/(1 − Y) = 1/3 − Y/15 − 2Y²/15 + (2/3)/(1 − Y)
//! ```
//!
//! Neo-Hookean as λL → ∞. At finite λL the modulus of the undeformed elastomer is larger than μ, by 3/(5λL²) at first
//! order.

use super::{Form, Response, StiffeningLaw};
use deaflow_base::{Decimal, parameters};

parameters! {
    /// Eight chains of limited extensibility (Arruda and Boyce, J. Mech. Phys. Solids 41 (1993) 389); μ is the network
    /// modulus n k T.
    pub struct ArrudaBoyce as "an arruda-boyce model" {
        /// The locking stretch of a chain.
        pub locking_stretch: Decimal [1.0..=1e6],
    }
}

impl StiffeningLaw for ArrudaBoyce {
    fn form(&self, _shear_modulus_pa: f64) -> Form {
        let locking = self.locking_stretch.to_f64();
        Form::FirstInvariant(Response {
            polynomial: [1.0 / 3.0, -1.0 / 15.0, -2.0 / 15.0],
            pole: 2.0 / 3.0,
            origin: 0.0,
            scale: 3.0 * locking * locking,
        })
    }
}
