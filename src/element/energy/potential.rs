//! Isotropic energies as functions of two invariants.
//!
//! In two dimensions an isotropic energy is w = φ(i, j) with i = f:f and j = det f, so five derivatives of φ determine
//! a material. With c = cof f,
//!
//! ```text
//! p  = 2φᵢ f + φⱼ c
//! dp = 2φᵢ df + φⱼ cof df + [4φᵢᵢ(f:df) + 2φᵢⱼ(c:df)] f + [2φᵢⱼ(f:df) + φⱼⱼ(c:df)] c
//! ```
//!
//! Effects only add to these five derivatives.

use std::ops::Add;

use pulp::{Simd, WithSimd};

use crate::kinematics::{Tensor, determinant};
use crate::lanes::Value;

/// The invariants of a deformation, relative to rest so that small strains keep their digits.
#[derive(Clone, Copy, Debug)]
pub struct Invariants<V> {
    /// i − 2j = (l₁ − l₂)².
    pub shear: V,
    /// j − 1.
    pub dilation: V,
    /// j = l₁l₂.
    pub area: V,
    /// 1/j.
    pub inverse: V,
}

impl<V: Value> Invariants<V> {
    /// Computes the invariants of f = I + ∇u.
    #[inline(always)]
    pub fn of(gradient: Tensor<V>) -> Self {
        let [[a, b], [c, d]] = gradient;
        let (across, twist) = (a - d, b + c);
        Self::new(across.madd(across, twist * twist), a + d + determinant(gradient))
    }

    /// Creates invariants from (l₁ − l₂)² and j − 1.
    #[inline(always)]
    pub fn new(shear: V, dilation: V) -> Self {
        let area = dilation.constant(1.0) + dilation;
        Self {
            shear,
            dilation,
            area,
            inverse: area.recip(),
        }
    }

    /// Computes the invariants of the squared stretches l₁² and l₂².
    #[inline(always)]
    pub fn of_squares(first: V, second: V) -> Self {
        let one = first.constant(1.0);
        let area = (first * second).sqrt();
        Self::new(first + second - one.constant(2.0) * area, area - one)
    }

    /// Returns i − 2.
    #[inline(always)]
    pub fn growth(&self) -> V {
        self.dilation.constant(2.0).madd(self.dilation, self.shear)
    }

    /// Returns j³ − 1 without cancellation.
    #[inline(always)]
    pub fn cube_minus_one(&self) -> V {
        let one = self.area.constant(1.0);
        self.dilation * self.area.madd(self.area + one, one)
    }

    /// Returns l₁² − l₂².
    #[inline(always)]
    pub fn split(&self) -> V {
        (self.shear * (self.area.constant(4.0) * self.area + self.shear)).sqrt()
    }
}

/// The derivatives of φ, with the factors of stress and tangent; φᵢ° and φⱼ° are those of the bare membrane at rest.
#[derive(Clone, Copy, Debug)]
pub struct Slopes<V> {
    /// 2(φᵢ − φᵢ°) + φⱼ − φⱼ°: equal-biaxial stress relative to the bare membrane at rest.
    pub pressure: V,
    /// 2φᵢ.
    pub i: V,
    /// φⱼ − φⱼ°.
    pub j: V,
    /// 4φᵢᵢ.
    pub ii: V,
    /// 2φᵢⱼ.
    pub ij: V,
    /// φⱼⱼ.
    pub jj: V,
}

impl<V: Value> Slopes<V> {
    /// Creates the derivatives of an energy of j alone that vanishes in the bare membrane.
    #[inline(always)]
    pub fn of_area(first: V, second: V) -> Self {
        let zero = first.constant(0.0);
        Self {
            pressure: first,
            i: zero,
            j: first,
            ii: zero,
            ij: zero,
            jj: second,
        }
    }

    /// Returns `yes` in the lanes where `sign` is positive, `no` in the others.
    #[inline(always)]
    pub fn choose(sign: V, yes: Self, no: Self) -> Self {
        Self {
            pressure: sign.choose(yes.pressure, no.pressure),
            i: sign.choose(yes.i, no.i),
            j: sign.choose(yes.j, no.j),
            ii: sign.choose(yes.ii, no.ii),
            ij: sign.choose(yes.ij, no.ij),
            jj: sign.choose(yes.jj, no.jj),
        }
    }

    /// Returns all derivatives times a factor.
    #[inline(always)]
    pub fn scaled(self, factor: V) -> Self {
        Self {
            pressure: factor * self.pressure,
            i: factor * self.i,
            j: factor * self.j,
            ii: factor * self.ii,
            ij: factor * self.ij,
            jj: factor * self.jj,
        }
    }
}

impl<V: Value> Add for Slopes<V> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self {
            pressure: self.pressure + other.pressure,
            i: self.i + other.i,
            j: self.j + other.j,
            ii: self.ii + other.ii,
            ij: self.ij + other.ij,
            jj: self.jj + other.jj,
        }
    }
}

/// 2φᵢ and φⱼ of the bare membrane at rest: its self-stress is 2φᵢ I + φⱼ cof f.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// 2φᵢ.
    pub i: f64,
    /// φⱼ.
    pub j: f64,
}

impl Add for Rest {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            i: self.i + other.i,
            j: self.j + other.j,
        }
    }
}

/// An isotropic energy per prestretched area, in units of μH.
pub trait Potential: Sync + 'static {
    /// Whether there can be several stable equilibria at one load.
    const SEVERAL_BRANCHES: bool = false;
    /// Whether it bears no compression.
    const WRINKLES: bool = false;

    /// Returns φ.
    fn energy<V: Value>(&self, at: &Invariants<V>, active: V) -> V;
    /// Returns the derivatives of φ.
    fn slopes<V: Value>(&self, at: &Invariants<V>, active: V) -> Slopes<V>;
    /// Returns the derivatives of the bare membrane at rest.
    fn rest(&self) -> Rest;
    /// Returns a number that is positive where φ is finite.
    #[inline(always)]
    fn admissible<V: Value>(&self, at: &Invariants<V>) -> V {
        at.area
    }
    /// Returns a lower bound and an estimate of the squared natural width: l₂² at which a strip of squared stretch l₁²
    /// has no stress across.
    fn natural_width<V: Value>(&self, first: V, active: V) -> [V; 2];
    /// Returns the largest number of Newton steps from the estimate to the natural width; 0 where the estimate is
    /// exact.
    fn width_steps(&self) -> u32;
    /// Returns the stress due to the voltage in an undisplaced active cell.
    fn load(&self) -> f64;
    /// Returns the decrease of φⱼⱼ of an undisplaced active cell per unit of load.
    fn softening(&self) -> f64;
    /// Returns the terms of the margins of stability.
    #[inline(always)]
    fn margin_terms<V: Value>(&self, at: &Invariants<V>, active: V) -> MarginTerms<V> {
        MarginTerms::taut(self.slopes(at, active), active)
    }
}

/// The terms of the margins of stability at a point.
#[derive(Clone, Copy, Debug)]
pub struct MarginTerms<V> {
    /// The derivatives of φ.
    pub slopes: Slopes<V>,
    /// Upper bound of the margin of ellipticity; without a natural width there is no ellipticity.
    pub bound: V,
    /// Positive where there is tension, which a wrinkling membrane needs to keep its shape.
    pub tension: V,
    /// Positive where the membrane is slack: there the bound alone determines ellipticity.
    pub is_slack: V,
}

impl<V: Value> MarginTerms<V> {
    /// Creates the terms of a taut membrane, which the derivatives determine.
    #[inline(always)]
    pub fn taut(slopes: Slopes<V>, active: V) -> Self {
        Self {
            slopes,
            bound: active.constant(f64::INFINITY),
            tension: active.constant(1.0),
            is_slack: active.constant(-1.0),
        }
    }
}

/// Evaluates [`Potential::margin_terms`] out of line: compiled once for each kind of number.
#[inline(never)]
pub fn margin_terms_out_of_line<P: Potential, V: Value>(
    potential: &P,
    at: &Invariants<V>,
    active: V,
) -> MarginTerms<V> {
    active.out_of_line(MarginTermsAt(SlopesAt { potential, at, active }))
}

struct MarginTermsAt<'a, P, V>(SlopesAt<'a, P, V>);

impl<P: Potential, V: Value> WithSimd for MarginTermsAt<'_, P, V> {
    type Output = MarginTerms<V>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> MarginTerms<V> {
        self.0.potential.margin_terms(self.0.at, self.0.active)
    }
}

/// Evaluates [`Potential::slopes`] out of line: compiled once for each kind of number. Inlined into every kernel, it
/// would multiply the build time of the program.
#[inline(never)]
pub fn slopes_out_of_line<P: Potential, V: Value>(potential: &P, at: &Invariants<V>, active: V) -> Slopes<V> {
    active.out_of_line(SlopesAt { potential, at, active })
}

struct SlopesAt<'a, P, V> {
    potential: &'a P,
    at: &'a Invariants<V>,
    active: V,
}

impl<P: Potential, V: Value> WithSimd for SlopesAt<'_, P, V> {
    type Output = Slopes<V>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Slopes<V> {
        self.potential.slopes(self.at, self.active)
    }
}

/// Evaluates [`Potential::energy`] out of line: compiled once for each kind of number.
#[inline(never)]
pub fn energy_out_of_line<P: Potential, V: Value>(potential: &P, at: &Invariants<V>, active: V) -> V {
    active.out_of_line(EnergyAt(SlopesAt { potential, at, active }))
}

struct EnergyAt<'a, P, V>(SlopesAt<'a, P, V>);

impl<P: Potential, V: Value> WithSimd for EnergyAt<'_, P, V> {
    type Output = V;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> V {
        self.0.potential.energy(self.0.at, self.0.active)
    }
}

/// Evaluates `pressure`, `i` and `j` of [`Potential::slopes`] out of line. It is compiled separately, so that nothing
/// else is computed.
#[inline(never)]
pub fn first_slopes_out_of_line<P: Potential, V: Value>(potential: &P, at: &Invariants<V>, active: V) -> [V; 3] {
    active.out_of_line(FirstSlopesAt(SlopesAt { potential, at, active }))
}

struct FirstSlopesAt<'a, P, V>(SlopesAt<'a, P, V>);

impl<P: Potential, V: Value> WithSimd for FirstSlopesAt<'_, P, V> {
    type Output = [V; 3];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [V; 3] {
        let slopes = self.0.with_simd(simd);
        [slopes.pressure, slopes.i, slopes.j]
    }
}
