//! Elastic energies of the first invariant alone, W = ψ(I₁).
//!
//! In the laws in use 2ψ′/μ is a polynomial in I₁, with or without a pole. One form covers them all:
//!
//! ```text
//! 2ψ′/μ = m = c₀ + c₁Y + c₂Y² + r/(1 − Y),   Y = (I₁ − I⁰)/s
//! ```
//!
//! With F = λp f, I₁ = λp² q and q = i + a j⁻², a = λp⁻⁶. Per prestretched area and in units of μH, ∂φ/∂q = ½m, so with
//! m_q = ∂m/∂q, q_j = −2a j⁻³ and q_jj = 6a j⁻⁴
//!
//! ```text
//! 2φᵢ = m,  φⱼ = ½m q_j,  4φᵢᵢ = 2m_q,  2φᵢⱼ = m_q q_j,  φⱼⱼ = ½m_q q_j² + ½m q_jj
//! ```

use super::potential::{Invariants, Rest, Slopes};
use crate::lanes::Value;
use crate::powers::logarithm_of_one_plus;
use deaflow_scene::laws::Response;

/// The energy of a response at a prestretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstInvariant {
    response: Response,
    /// a = λp⁻⁶.
    thickness: f64,
    /// λp²/s, the slope of Y over q.
    rate: f64,
    /// Y at rest.
    rest: f64,
    /// m at rest.
    modulus: f64,
    /// Primitive of ½m over q for the undeformed elastomer.
    undeformed: f64,
}

impl FirstInvariant {
    /// Creates the energy at prestretch λp; `None` where it is infinite there.
    #[must_use]
    pub fn new(response: Response, prestretch: f64) -> Option<Self> {
        let squared = prestretch * prestretch;
        let reduced = |first: f64| (first - response.origin) / response.scale;
        let rest = reduced(2.0 * squared + (squared * squared).recip());
        if rest >= 1.0 {
            return None;
        }
        let [c0, c1, c2] = response.polynomial;
        let energy = Self {
            response,
            thickness: prestretch.powi(-6),
            rate: squared / response.scale,
            rest,
            modulus: c0 + rest * (c1 + rest * c2) + response.pole / (1.0 - rest),
            undeformed: 0.0,
        };
        Some(Self {
            undeformed: energy.primitive(reduced(3.0)),
            ..energy
        })
    }

    /// Returns Y − Y°.
    #[inline(always)]
    fn rise<V: Value>(&self, at: &Invariants<V>) -> V {
        let one = at.area.constant(1.0);
        let thinning = at.dilation * (at.area + one) * (at.inverse * at.inverse);
        let q = at.area.constant(-self.thickness).madd(thinning, at.growth());
        at.area.constant(self.rate) * q
    }

    /// Returns ∫½m dq up to Y, up to a constant.
    #[inline(always)]
    fn primitive<V: Value>(&self, y: V) -> V {
        let [c0, c1, c2] = self.response.polynomial.map(|c| 0.5 * c / self.rate);
        let cubic = y.constant(c2 / 3.0).madd(y, y.constant(0.5 * c1));
        let polynomial = y * cubic.madd(y, y.constant(c0));
        polynomial - y.constant(0.5 * self.response.pole / self.rate) * logarithm_of_one_plus(-y)
    }

    /// Returns φ.
    #[inline(always)]
    pub fn energy<V: Value>(&self, at: &Invariants<V>) -> V {
        let y = self.rise(at) + at.area.constant(self.rest);
        self.primitive(y) - at.area.constant(self.undeformed)
    }

    /// Returns the derivatives of φ.
    #[inline(always)]
    pub fn slopes<V: Value>(&self, at: &Invariants<V>) -> Slopes<V> {
        let number = |value: f64| at.area.constant(value);
        let [_, c1, c2] = self.response.polynomial;
        let rise = self.rise(at);
        let y = rise + number(self.rest);
        let reach = (number(1.0) - y).recip();
        let pole = number(self.response.pole) * reach;
        let linear = number(c2).madd(y, number(c1));
        let secant = pole.madd(number(1.0 / (1.0 - self.rest)), number(c2 * self.rest) + linear);
        let change = rise * secant;
        let m = change + number(self.modulus);
        let slope = number(self.rate) * pole.madd(reach, number(c2).madd(y, linear));
        let cube = at.inverse * (at.inverse * at.inverse);
        let cubic = number(self.thickness) * cube;
        // −a(m j⁻³ − m°)
        let first = cubic * (number(self.modulus).madd(at.cube_minus_one(), -change));
        let falling = number(-2.0) * cubic;
        let cross = slope * falling;
        Slopes {
            pressure: change + first,
            i: m,
            j: first,
            ii: slope + slope,
            ij: cross,
            jj: (number(0.5) * cross).madd(falling, number(3.0) * m * cubic * at.inverse),
        }
    }

    /// Returns the derivatives at rest.
    #[must_use]
    pub fn rest(&self) -> Rest {
        Rest {
            i: self.modulus,
            j: -self.modulus * self.thickness,
        }
    }

    /// Returns a number that is positive where φ is finite.
    #[inline(always)]
    pub fn admissible<V: Value>(&self, at: &Invariants<V>) -> V {
        let below_pole = at.area.constant(1.0 - self.rest) - self.rise(at);
        at.area.min(below_pole)
    }
}
