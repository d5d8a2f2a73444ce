//! Ogden's law in principal stretches (Proc. R. Soc. A 326 (1972) 565): W = Σ (μₚ/αₚ)(λ₁^αₚ + λ₂^αₚ + λ₃^αₚ − 3).
//!
//! The in-plane part of a term is a function of i and j that is smooth where the stretches are equal. With β = α/2,
//! l₁ = √j e^ρ, l₂ = √j e^(−ρ) and c = cosh 2ρ = i/2j,
//!
//! ```text
//! l₁^α + l₂^α = 2 j^β T(c),   T(c) = cosh(β arcosh c) = 1 + β²(c − 1) + β²(β² − 1)/6 (c − 1)² + …
//! ```
//!
//! T is the Chebyshev polynomial of real degree β; its n-th derivative at 1 is Π (β² − k²)/(2k + 1), k < n (Abramowitz
//! and Stegun, 22.14 and 15.4). Where stretches differ by less than a fifth, the series is summed at ρ. Elsewhere it is
//! summed at ρ/8 and doubled three times by T(c) = 2T(√((1 + c)/2))² − 1. c − 1 = (l₁ − l₂)²/2j has no cancellation,
//! and no root of a stretch is needed. In that form
//!
//! ```text
//! φᵢ = A j^(β−1) T′,  φⱼ = 2A j^(β−1)(βT − cT′),  φᵢᵢ = ½A j^(β−2) T″,
//! φᵢⱼ = A j^(β−2)((β − 1)T′ − cT″),  φⱼⱼ = 2A j^(β−2)(β(β − 1)T − 2(β − 1)cT′ + c²T″)
//! ```
//!
//! with A = (μₚ/μαₚ) λp^(α−2). The thickness adds B j^(−α) with B = (μₚ/μαₚ) λp^(−2α−2). All terms share the roots and
//! ln j; each needs one exponential.

use super::potential::{Invariants, Rest, Slopes};
use crate::lanes::Value;
use crate::powers::{exponential_minus_one, logarithm_of_one_plus};

/// Largest number of terms.
pub const MOST_TERMS: usize = 3;
/// Number of terms of the series of T: exact to rounding for stretch ratios up to 5 at |α| ≤ 5, and up to 2 at |α| ≤
/// 15.
const SERIES: usize = 10;
/// Number of terms in single precision.
const SINGLE_SERIES: usize = 6;
/// Number of doublings where stretches differ much.
const DOUBLINGS: usize = 3;
/// Largest c − 1 at which the series is summed: that of a stretch ratio of 5 after all doublings, or of 1.22 without.
const NEAR: f64 = 0.02;

/// The energy of one to three terms at a prestretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ogden {
    terms: [Term; MOST_TERMS],
    count: usize,
    undeformed: f64,
}

/// One term.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Term {
    /// β = α/2.
    beta: f64,
    /// A.
    plane: f64,
    /// B.
    thickness: f64,
    /// The coefficients of T, from the first power of c − 1.
    series: [f64; SERIES],
}

/// T − 1, T′, T′ − β² and T″.
struct Chebyshev<V> {
    rise: V,
    first: V,
    first_rise: V,
    second: V,
}

/// Functions of the deformation that all terms share.
struct Shared<V, const D: usize> {
    /// ln j.
    logarithm: V,
    /// c − 1 and c at ρ.
    excess: V,
    cosine: V,
    /// c − 1 and 1/c at ρ/2, ρ/4 … for each doubling.
    levels: [[V; 2]; D],
}

/// Returns c − 1.
#[inline(always)]
fn excess<V: Value>(at: &Invariants<V>) -> V {
    at.area.constant(0.5) * at.shear * at.inverse
}

/// Returns whether stretches differ so much in any lane that the series has to be doubled.
#[inline(always)]
fn is_far<V: Value>(at: &Invariants<V>) -> bool {
    (excess(at) - at.area.constant(NEAR)).any_positive()
}

impl<V: Value, const D: usize> Shared<V, D> {
    #[inline(always)]
    fn of(at: &Invariants<V>) -> Self {
        let (one, half) = (at.area.constant(1.0), at.area.constant(0.5));
        let excess = excess(at);
        let mut levels = [[excess, one]; D];
        let (mut above, mut argument) = (excess, excess + one);
        for level in &mut levels {
            argument = (half * (argument + one)).sqrt();
            above = half * above * (argument + one).recip();
            *level = [above, argument.recip()];
        }
        Self {
            logarithm: logarithm_of_one_plus(at.dilation),
            excess,
            cosine: excess + one,
            levels,
        }
    }
}

impl Ogden {
    /// Creates the energy of terms (μₚ/μ, αₚ) at prestretch λp. Terms beyond [`MOST_TERMS`] are ignored.
    #[must_use]
    pub fn new(terms: &[(f64, f64)], prestretch: f64) -> Self {
        let mut energy = Self {
            terms: [Term::default(); MOST_TERMS],
            count: terms.len().min(MOST_TERMS),
            undeformed: terms
                .iter()
                .map(|(modulus, alpha)| 3.0 * modulus / alpha / (prestretch * prestretch))
                .sum(),
        };
        for (term, &(modulus, alpha)) in energy.terms.iter_mut().zip(terms) {
            *term = Term::new(modulus, alpha, prestretch);
        }
        energy
    }
}

impl Term {
    fn new(modulus: f64, alpha: f64, prestretch: f64) -> Self {
        let beta = 0.5 * alpha;
        let mut series = [0.0; SERIES];
        let mut last = 1.0;
        for (k, entry) in series.iter_mut().enumerate() {
            let k = k as f64;
            last *= (beta * beta - k * k) / ((2.0 * k + 1.0) * (k + 1.0));
            *entry = last;
        }
        Self {
            beta,
            plane: modulus / alpha * prestretch.powf(alpha - 2.0),
            thickness: modulus / alpha * prestretch.powf(-2.0 * alpha - 2.0),
            series,
        }
    }

    #[inline(always)]
    fn chebyshev<V: Value, const D: usize>(&self, shared: &Shared<V, D>) -> Chebyshev<V> {
        let z = shared.levels.last().map_or(shared.excess, |level| level[0]);
        let number = |value: f64| z.constant(value);
        let square = number(self.beta * self.beta);
        let (mut value, mut slope, mut curvature) = (number(0.0), number(0.0), number(0.0));
        let terms = if V::SINGLE { SINGLE_SERIES } else { SERIES };
        for at in (0..terms).rev() {
            let n = (at + 1) as f64;
            value = value.madd(z, number(self.series[at]));
            if at > 0 {
                slope = slope.madd(z, number(n * self.series[at]));
                curvature = curvature.madd(z, number(n * (n - 1.0) * self.series[at]));
            }
        }
        let mut t = Chebyshev {
            rise: value * z,
            first: slope.madd(z, square),
            first_rise: slope * z,
            second: curvature,
        };
        for [excess, inverse] in shared.levels.iter().rev().copied() {
            let polynomial = t.rise + number(1.0);
            let first = polynomial * t.first * inverse;
            let bend = (t.first.madd(t.first, polynomial * t.second) - first) * inverse;
            t = Chebyshev {
                rise: number(2.0) * t.rise * (t.rise + number(2.0)),
                first_rise: (t.rise.madd(t.first, t.first_rise) - square * excess) * inverse,
                first,
                second: number(0.25) * bend * inverse,
            };
        }
        t
    }

    #[inline(always)]
    fn energy<V: Value, const D: usize>(&self, shared: &Shared<V, D>) -> V {
        let number = |value: f64| shared.logarithm.constant(value);
        let t = self.chebyshev(shared);
        let power = exponential_minus_one(number(self.beta) * shared.logarithm) + number(1.0);
        let plane = number(2.0 * self.plane) * power * (t.rise + number(1.0));
        plane + number(self.thickness) * (power * power).recip()
    }

    #[inline(always)]
    fn slopes<V: Value, const D: usize>(&self, at: &Invariants<V>, shared: &Shared<V, D>) -> Slopes<V> {
        let number = |value: f64| at.area.constant(value);
        let t = self.chebyshev(shared);
        let (one, beta) = (number(1.0), number(self.beta));
        let rise = exponential_minus_one(beta * shared.logarithm);
        let power = rise + one;
        // j^(β−1) − 1, j^(β−1) and j^(β−2).
        let lower_rise = (rise - at.dilation) * at.inverse;
        let lower = power * at.inverse;
        let lowest = lower * at.inverse;
        let (excess, c) = (shared.excess, shared.cosine);
        let polynomial = t.rise + one;
        let plane = number(self.plane);
        let i = number(2.0) * plane * lower * t.first;
        let i_rise = number(2.0) * plane * lower_rise.madd(t.first, t.first_rise);
        let bracket = beta * polynomial - c * t.first;
        let bracket_rise = beta * t.rise - excess * t.first - t.first_rise;
        let area = number(2.0) * plane * lower_rise.madd(bracket, bracket_rise);
        // −αB(j^(−α−1) − 1) and its derivative.
        let inverse_square = (power * power).recip();
        let thin = number(2.0 * self.beta * self.thickness) * inverse_square * at.inverse;
        let relief = (rise * (rise + number(2.0))).madd(at.area, at.dilation);
        let first = thin.madd(relief, area);
        let less = beta - one;
        let double = c * t.first * less;
        let stretch = c * c * t.second - (double + double);
        let bend = (less * beta).madd(polynomial, stretch);
        let scale = number(2.0) * plane * lowest;
        Slopes {
            pressure: i_rise + first,
            i,
            j: first,
            ii: scale * t.second,
            ij: scale * (less * t.first - c * t.second),
            jj: scale.madd(bend, number(2.0 * self.beta + 1.0) * thin * at.inverse),
        }
    }

    fn rest(&self) -> Rest {
        Rest {
            i: 2.0 * self.plane * self.beta * self.beta,
            j: 2.0 * self.beta * (self.plane * (1.0 - self.beta) - self.thickness),
        }
    }
}

impl Ogden {
    /// Returns φ.
    #[inline(always)]
    pub fn energy<V: Value>(&self, at: &Invariants<V>) -> V {
        if is_far(at) {
            self.energy_doubled::<V, DOUBLINGS>(at)
        } else {
            self.energy_doubled::<V, 0>(at)
        }
    }

    #[inline(always)]
    fn energy_doubled<V: Value, const D: usize>(&self, at: &Invariants<V>) -> V {
        let shared = Shared::<V, D>::of(at);
        let mut sum = at.area.constant(-self.undeformed);
        for term in &self.terms[..self.count] {
            sum = sum + term.energy(&shared);
        }
        sum
    }

    /// Returns the derivatives of φ.
    #[inline(always)]
    pub fn slopes<V: Value>(&self, at: &Invariants<V>) -> Slopes<V> {
        if is_far(at) {
            self.slopes_doubled::<V, DOUBLINGS>(at)
        } else {
            self.slopes_doubled::<V, 0>(at)
        }
    }

    #[inline(always)]
    fn slopes_doubled<V: Value, const D: usize>(&self, at: &Invariants<V>) -> Slopes<V> {
        let shared = Shared::<V, D>::of(at);
        let mut sum = self.terms[0].slopes(at, &shared);
        for term in &self.terms[1..self.count.max(1)] {
            sum = sum + term.slopes(at, &shared);
        }
        sum
    }

    /// Returns the derivatives at rest.
    #[must_use]
    pub fn rest(&self) -> Rest {
        let mut sum = Rest { i: 0.0, j: 0.0 };
        for term in &self.terms {
            let rest = term.rest();
            sum = Rest {
                i: sum.i + rest.i,
                j: sum.j + rest.j,
            };
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(s: &Slopes<f64>) -> [f64; 6] {
        [s.pressure, s.i, s.j, s.ii, s.ij, s.jj]
    }

    #[test]
    fn the_series_agrees_with_its_doubled_form() {
        let energy = Ogden::new(&[(1.0, 1.3), (0.1, 5.0), (-0.1, -2.0)], 3.0);
        for (share, dilation) in [0.0, 1e-6, 0.1, 0.5, 1.0]
            .into_iter()
            .flat_map(|share| [-0.2, 0.0, 0.3].map(|dilation| (share, dilation)))
        {
            let at = Invariants::<f64>::new(share * 2.0 * NEAR * (1.0 + dilation), dilation);
            let direct = numbers(&energy.slopes_doubled::<f64, 0>(&at));
            let doubled = numbers(&energy.slopes_doubled::<f64, DOUBLINGS>(&at));
            let energies = [
                energy.energy_doubled::<f64, 0>(&at),
                energy.energy_doubled::<f64, DOUBLINGS>(&at),
            ];
            let mut pairs = direct.iter().zip(&doubled).chain([(&energies[0], &energies[1])]);
            assert!(
                pairs.all(|(a, b)| (a - b).abs() < 1e-14 * (1.0 + a.abs())),
                "{share} {dilation}: {direct:?} {doubled:?}"
            );
        }
    }
}
