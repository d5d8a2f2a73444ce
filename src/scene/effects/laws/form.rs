//! The forms of energy for which kernels are compiled.

/// An elastic energy, divided by the shear modulus.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// ψ(I₁).
    FirstInvariant(Response),
    /// ψ(I₁) + c(I₂ − 3).
    BothInvariants(Response, f64),
    /// Σ (mₚ/αₚ)(λ₁^αₚ + λ₂^αₚ + λ₃^αₚ − 3), as pairs of mₚ and αₚ.
    Stretches(Vec<(f64, f64)>),
}

/// 2ψ′ as a function of I₁, a polynomial with at most one pole:
///
/// ```text
/// 2ψ′ = m = c₀ + c₁Y + c₂Y² + r/(1 − Y),   Y = (I₁ − I⁰)/s
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// c₀, c₁ and c₂.
    pub polynomial: [f64; 3],
    /// r.
    pub pole: f64,
    /// I⁰.
    pub origin: f64,
    /// s.
    pub scale: f64,
}

/// A scale of I₁ − 3 so large that the pole is never reached.
const FAR: f64 = 1e9;

impl Response {
    /// Returns the response c₀ + c₁(I₁ − 3) + c₂(I₁ − 3)².
    #[must_use]
    pub fn polynomial([c0, c1, c2]: [f64; 3]) -> Self {
        Self {
            polynomial: [c0, c1 * FAR, c2 * FAR * FAR],
            pole: 0.0,
            origin: 3.0,
            scale: FAR,
        }
    }
}
