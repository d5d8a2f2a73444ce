//! Isotropic energies as functions of two invariants.
//!
//! In two dimensions an isotropic energy is w = φ(i, j) with i = f:f and j = det f, so a law needs no more than five
//! derivatives of φ. With c = cof f,
//!
//! ```text
//! p  = 2φᵢ f + φⱼ c
//! dp = 2φᵢ df + φⱼ cof df + [4φᵢᵢ(f:df) + 2φᵢⱼ(c:df)] f + [2φᵢⱼ(f:df) + φⱼⱼ(c:df)] c
//! ```
//!
//! The effects add to the five; nothing else of a law knows of them.

use std::ops::Add;

use pulp::{Simd, WithSimd};

use crate::kinematics::{Tensor, determinant};
use crate::lanes::Value;

/// What an isotropic energy depends on, measured from rest so that small strains keep their digits.
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
    /// Those of f = I + ∇u.
    #[inline(always)]
    pub fn of(gradient: Tensor<V>) -> Self {
        let [[a, b], [c, d]] = gradient;
        let (across, twist) = (a - d, b + c);
        Self::new(across.madd(across, twist * twist), a + d + determinant(gradient))
    }

    /// Those with given (l₁ − l₂)² and j − 1.
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

    /// Those of the squared stretches l₁² and l₂².
    #[inline(always)]
    pub fn of_squares(first: V, second: V) -> Self {
        let one = first.constant(1.0);
        let area = (first * second).sqrt();
        Self::new(first + second - one.constant(2.0) * area, area - one)
    }

    /// i − 2.
    #[inline(always)]
    pub fn growth(&self) -> V {
        self.dilation.constant(2.0).madd(self.dilation, self.shear)
    }

    /// l₁² − l₂².
    #[inline(always)]
    pub fn split(&self) -> V {
        (self.shear * (self.area.constant(4.0) * self.area + self.shear)).sqrt()
    }
}

/// The derivatives of φ in the multiples that stress and tangent need, φᵢ° and φⱼ° being those of the bare membrane at rest.
#[derive(Clone, Copy, Debug)]
pub struct Slopes<V> {
    /// 2(φᵢ − φᵢ°) + φⱼ − φⱼ°: the equal stress beyond that of the bare membrane at rest.
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
    /// Those of an energy that depends on j alone and is not there in the bare membrane.
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

    /// `yes` in the lanes where `sign` is positive, `no` in the others.
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

    /// All six times a factor.
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
pub trait Potential: Sync + Sized + 'static {
    /// Whether there can be several stable equilibria at one load.
    fn has_several_branches(&self) -> bool;
    /// Whether it bears no compression.
    fn wrinkles(&self) -> bool {
        false
    }

    /// φ.
    fn energy<V: Value>(&self, at: &Invariants<V>, active: V) -> V;
    /// The derivatives of φ.
    fn slopes<V: Value>(&self, at: &Invariants<V>, active: V) -> Slopes<V>;
    /// Of the bare membrane at rest.
    fn rest(&self) -> Rest;
    /// Positive where φ is finite.
    #[inline(always)]
    fn admissible<V: Value>(&self, at: &Invariants<V>) -> V {
        at.area
    }
    /// The stress that the voltage causes in an undisplaced active cell.
    fn load(&self) -> f64;
    /// By how much φⱼⱼ of an undisplaced active cell falls for each unit of load.
    fn softening(&self) -> f64;
    /// The slopes with what the margins of a potential that wrinkles need beside them.
    #[inline(always)]
    fn watched<V: Value>(&self, at: &Invariants<V>, active: V) -> Watched<V> {
        Watched::taut(self.slopes(at, active), active)
    }

    /// [`energy_apart`], or the same of the potential that this one stands for; so are the others.
    #[inline(always)]
    fn energy_apart<V: Value>(&self, at: &Invariants<V>, active: V) -> V {
        energy_apart(self, at, active)
    }
    /// [`slopes_apart`].
    #[inline(always)]
    fn slopes_apart<V: Value>(&self, at: &Invariants<V>, active: V) -> Slopes<V> {
        slopes_apart(self, at, active)
    }
    /// [`first_slopes_apart`].
    #[inline(always)]
    fn first_slopes_apart<V: Value>(&self, at: &Invariants<V>, active: V) -> [V; 3] {
        first_slopes_apart(self, at, active)
    }
    /// [`watched_apart`].
    #[inline(always)]
    fn watched_apart<V: Value>(&self, at: &Invariants<V>, active: V) -> Watched<V> {
        watched_apart(self, at, active)
    }
}

/// What [`Potential::watched`] says of a point.
#[derive(Clone, Copy, Debug)]
pub struct Watched<V> {
    /// The derivatives of φ.
    pub slopes: Slopes<V>,
    /// What the margin of ellipticity is not above: where there is no natural width there is no ellipticity.
    pub bound: V,
    /// Positive where there is tension, as a potential that wrinkles needs to hold its shape.
    pub tension: V,
    /// Positive where the slopes say nothing about ellipticity, and the bound alone does.
    pub is_loose: V,
}

impl<V: Value> Watched<V> {
    /// Where nothing wrinkles the slopes say all.
    #[inline(always)]
    pub fn taut(slopes: Slopes<V>, active: V) -> Self {
        Self {
            slopes,
            bound: active.constant(f64::INFINITY),
            tension: active.constant(1.0),
            is_loose: active.constant(-1.0),
        }
    }
}

/// [`Potential::watched`], compiled once for each kind of number.
#[inline(never)]
pub fn watched_apart<P: Potential, V: Value>(potential: &P, at: &Invariants<V>, active: V) -> Watched<V> {
    active.apart(WatchedAt(SlopesAt { potential, at, active }))
}

struct WatchedAt<'a, P, V>(SlopesAt<'a, P, V>);

impl<P: Potential, V: Value> WithSimd for WatchedAt<'_, P, V> {
    type Output = Watched<V>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Watched<V> {
        self.0.potential.watched(self.0.at, self.0.active)
    }
}

/// [`Potential::slopes`], compiled once for each kind of number: inlined into every kernel it would make the program several
/// times as long to build.
#[inline(never)]
pub fn slopes_apart<P: Potential, V: Value>(potential: &P, at: &Invariants<V>, active: V) -> Slopes<V> {
    active.apart(SlopesAt { potential, at, active })
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

/// [`Potential::energy`], compiled once for each kind of number.
#[inline(never)]
pub fn energy_apart<P: Potential, V: Value>(potential: &P, at: &Invariants<V>, active: V) -> V {
    active.apart(EnergyAt(SlopesAt { potential, at, active }))
}

struct EnergyAt<'a, P, V>(SlopesAt<'a, P, V>);

impl<P: Potential, V: Value> WithSimd for EnergyAt<'_, P, V> {
    type Output = V;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> V {
        self.0.potential.energy(self.0.at, self.0.active)
    }
}

/// What stress needs of [`Potential::slopes`]: `pressure`, `i` and `j`. Compiled apart from the others, so that nothing else is computed.
#[inline(never)]
pub fn first_slopes_apart<P: Potential, V: Value>(potential: &P, at: &Invariants<V>, active: V) -> [V; 3] {
    active.apart(FirstSlopesAt(SlopesAt { potential, at, active }))
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
