//! Gent's law of limited extensibility (Rubber Chem. Technol. 69 (1996) 59).
//!
//! W = −½μ Jm ln(1 − (I₁ − 3)/Jm), so 2ψ′/μ = 1/(1 − (I₁ − 3)/Jm). Neo-Hookean as Jm → ∞.

use super::first_invariant::Response;

/// The response with Jm, the limit of I₁ − 3.
#[must_use]
pub fn gent(limit: f64) -> Response {
    Response {
        polynomial: [0.0; 3],
        pole: 1.0,
        origin: 3.0,
        scale: limit,
    }
}
