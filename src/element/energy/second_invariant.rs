//! Elastic energy linear in the second invariant, W/μ = c(I₂ − 3).
//!
//! With F = λp f and incompressibility, I₂ = λp⁴j² + λp⁻² i j⁻². Per prestretched area and in units of μH, with p =
//! cλp² and q = cλp⁻⁴,
//!
//! ```text
//! φ  = p j² + q i j⁻² − 3c/λp²
//! φᵢ = q j⁻²,  φⱼ = 2pj − 2q i j⁻³,  φᵢⱼ = −2q j⁻³,  φⱼⱼ = 2p + 6q i j⁻⁴
//! ```

use super::potential::{Invariants, Rest, Slopes};
use crate::lanes::Value;

/// The energy at a prestretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondInvariant {
    /// p.
    plane: f64,
    /// q.
    thickness: f64,
    /// 3c/λp².
    undeformed: f64,
}

impl SecondInvariant {
    /// Creates the energy with coefficient c at prestretch λp.
    #[must_use]
    pub fn new(coefficient: f64, prestretch: f64) -> Self {
        let squared = prestretch * prestretch;
        Self {
            plane: coefficient * squared,
            thickness: coefficient / (squared * squared),
            undeformed: 3.0 * coefficient / squared,
        }
    }

    /// Returns φ.
    #[inline(always)]
    pub fn energy<V: Value>(&self, at: &Invariants<V>) -> V {
        let number = |value: f64| at.area.constant(value);
        let plane = number(self.plane) * at.area * at.area - number(self.undeformed);
        let stretched = (at.growth() + number(2.0)) * (at.inverse * at.inverse);
        number(self.thickness).madd(stretched, plane)
    }

    /// Returns the derivatives of φ.
    #[inline(always)]
    pub fn slopes<V: Value>(&self, at: &Invariants<V>) -> Slopes<V> {
        let number = |value: f64| at.area.constant(value);
        let square = at.inverse * at.inverse;
        let cube = square * at.inverse;
        let (plane, twice) = (number(2.0 * self.plane), number(2.0 * self.thickness));
        let growth = at.growth();
        // −2q(i j⁻³ − 2), where i j⁻³ − 2 = (i − 2 − 2(j³ − 1))j⁻³.
        let relieved = at.cube_minus_one();
        let thinning = twice * cube * (relieved + relieved - growth);
        let first = plane.madd(at.dilation, thinning);
        let thinner = twice * square * at.dilation * (at.area + number(1.0));
        Slopes {
            pressure: first - thinner,
            i: twice * square,
            j: first,
            ii: number(0.0),
            ij: number(-2.0) * twice * cube,
            jj: (number(3.0) * twice * (growth + number(2.0))).madd(cube * at.inverse, plane),
        }
    }

    /// Returns the derivatives at rest.
    #[must_use]
    pub fn rest(&self) -> Rest {
        Rest {
            i: 2.0 * self.thickness,
            j: 2.0 * self.plane - 4.0 * self.thickness,
        }
    }
}
