//! Yeoh's cubic law (Rubber Chem. Technol. 66 (1993) 754).
//!
//! W = ½μ(I₁ − 3) + C₂(I₁ − 3)² + C₃(I₁ − 3)³, so 2ψ′/μ = 1 + 4(C₂/μ)(I₁ − 3) + 6(C₃/μ)(I₁ − 3)². Neo-Hookean where both
//! are zero.

use super::first_invariant::Response;

/// The unit of I₁ − 3: so large that the limit of the common form is out of reach.
const SCALE: f64 = 1e9;

/// The response with C₂/μ and C₃/μ.
#[must_use]
pub fn yeoh(second: f64, third: f64) -> Response {
    Response {
        polynomial: [1.0, 4.0 * second * SCALE, 6.0 * third * SCALE * SCALE],
        pole: 0.0,
        origin: 3.0,
        scale: SCALE,
    }
}
