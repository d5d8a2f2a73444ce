//! Wrinkling by tension-field theory: a membrane that wrinkles instead of bearing compression.
//!
//! The energy is replaced by its relaxation (Pipkin, IMA J. Appl. Math. 36 (1986) 85; with an electric field Greaney,
//! Meere and Zurlo, J. Mech. Phys. Solids 122 (2019) 84). With
//! principal stretches l₁ ≥ l₂ and φ₁, φ₂ the derivatives of φ along them, there are three branches:
//!
//! ```text
//! taut      φ₂(l₁, l₂) ≥ 0                 φ(l₁, l₂)
//! wrinkled  φ₂(l₁, l₂) < 0                 φ(l₁, w(l₁)),  where φ₂(l₁, w) = 0
//! slack     … and P₁ = φ₁(l₁, w) ≤ 0       constant
//! ```
//!
//! The natural width w of the ideal neo-Hookean dielectric is λ₁^(−½)(1 − κλ₁²)^(−¼) in total stretches. For other
//! potentials it is computed by Newton steps on the nearly linear l₂³φ₂ as a function of l₂⁴, kept between bounds; the
//! lower one is the width without voltage, which is that of uniaxial tension, λ₁^(−½), for every law. In the wrinkled
//! branch φ is a function of x₁ = l₁² alone; with D = x₁ − x₂, η = P₁/2l₁ and η′ = dη/dx₁
//!
//! ```text
//! φᵢ  = η x₁/D,                    φⱼ  = −2ηj/D,
//! φᵢᵢ = η′x₁²/D² − 2ηj²/D³,        φᵢⱼ = −2η′x₁j/D² + 2ηij/D³,       φⱼⱼ = 4η′j²/D² − 2ηi²/D³,
//! dP₁/dl₁ = φ₁₁ − φ₁₂²/φ₂₂
//! ```
//!
//! Ellipticity is lost where dP₁/dl₁ = 0 (Zurlo, arXiv 1908.06690, calls it the tension-extension inequality), at the
//! latest where no natural width exists: κλ₁² = 1.
//!
//! Wrinkled and slack membrane keeps a share [`RESIDUAL`] of the flat potential, so that displacements across wrinkles
//! are determined and elements are not inverted. It vanishes where wrinkling begins, as does its slope.

use pulp::{Simd, WithSimd};

use super::potential::{Invariants, MarginTerms, Potential, Rest, Slopes, slopes_out_of_line};
use crate::lanes::Value;

/// The share of the flat potential in wrinkled membrane.
pub const RESIDUAL: f64 = 1e-3;
/// Gaps between squared stretches below this are rounding.
const SMALLEST_GAP: f64 = 1e-12;
/// Compression below this is rounding.
const SMALLEST_COMPRESSION: f64 = 1e-12;
/// Relative change of the squared width after which one more Newton step is exact; rounding in single precision is
/// smaller.
const SETTLED: f64 = 1e-5;
/// Upper bound of the squared width.
const LARGEST_WIDTH: f64 = 1e12;
/// Tolerance of the stress across at the natural width, for rounding and the last Newton step.
const WIDTH_TOLERANCE: f64 = 1e-4;

/// The natural width varies about like the inverse root of the length, so each step at least halves the error.
const FIXED_POINT_STEPS: u32 = 60;

/// A potential without compression.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TensionField<P> {
    flat: P,
}

/// Principal stretches and the derivatives of the flat potential.
struct Principal<V> {
    /// x₁ and x₁ − x₂.
    first: V,
    gap: V,
    /// −φ₂, positive where the membrane wrinkles.
    compression: V,
    slopes: Slopes<V>,
}

/// The strip of natural width.
struct Strip<V> {
    /// P₁ and dP₁/dl₁.
    stress: V,
    stiffness: V,
    /// φ₂ and φ₂₂ at the computed natural width.
    across: V,
    lateral: V,
    at: Invariants<V>,
}

impl<P: Potential> TensionField<P> {
    /// Relaxes a potential.
    #[must_use]
    pub fn new(flat: P) -> Self {
        Self { flat }
    }
    #[inline(always)]
    fn principal<V: Value>(&self, at: &Invariants<V>, active: V) -> Principal<V> {
        let slopes = slopes_out_of_line(&self.flat, at, active);
        let gap = at.split();
        let half = active.constant(0.5);
        let first = half * (at.shear + at.area + at.area + gap);
        let length = first.sqrt();
        let j = slopes.j + active.constant(self.flat.rest().j);
        let along = slopes.i * at.area * length.recip();
        Principal {
            first,
            gap,
            compression: -(j.madd(length, along)) - active.constant(SMALLEST_COMPRESSION),
            slopes,
        }
    }

    /// Returns φ₁, φ₂, φ₁₁, φ₁₂ and φ₂₂ at squared stretches.
    #[inline(always)]
    fn derivatives<V: Value>(&self, at: &Invariants<V>, first: V, second: V, active: V) -> [V; 5] {
        let s = slopes_out_of_line(&self.flat, at, active);
        let j = s.j + active.constant(self.flat.rest().j);
        let (one, two) = (first.sqrt(), second.sqrt());
        let cross = (s.ij + s.ij).madd(at.area, s.i);
        [
            s.i.madd(one, j * two),
            s.i.madd(two, j * one),
            s.ii.madd(first, s.jj.madd(second, cross)),
            s.ij.madd(first + second, (s.ii + s.jj).madd(at.area, j)),
            s.ii.madd(second, s.jj.madd(first, cross)),
        ]
    }

    /// Returns the square of the natural width at x₁: Newton steps on l₂³φ₂ as a function of l₂⁴, between bounds, until
    /// they have converged in all lanes, and one more.
    #[inline(always)]
    fn width<V: Value>(&self, first: V, active: V) -> V {
        let [mut low, mut x] = self.flat.natural_width(first, active);
        let (one, four) = (active.constant(1.0), active.constant(4.0));
        let mut high = active.constant(LARGEST_WIDTH);
        let mut settled = false;
        for _ in 0..self.flat.width_steps() {
            let at = Invariants::of_squares(first, x);
            let [_, across, _, _, lateral] = self.derivatives(&at, first, x, active);
            // An infinite potential means that the stretch is too large.
            let inside = self.flat.admissible(&at);
            let excess = inside.choose(across, one);
            high = excess.choose(x, high);
            low = excess.choose(low, x);
            let two = x.sqrt();
            let slope = (active.constant(3.0) * across).madd(two.recip(), lateral);
            let square = x.madd(x, -(four * across * x * two * slope.recip()));
            let newton = square.max(active.constant(0.0)).sqrt();
            // A step out of bounds by rounding only is accepted.
            let below = low * active.constant(1.0 - SETTLED) - newton;
            let above = newton - high * active.constant(1.0 + SETTLED);
            let misled = below.max(above).max(-inside).max(-slope);
            let next = misled.choose((low * high.min(four * low)).sqrt(), newton);
            let change = next - x;
            x = next;
            if settled {
                break;
            }
            settled = !(change.max(-change) - active.constant(SETTLED) * x).any_positive();
        }
        x
    }

    #[inline(always)]
    fn strip<V: Value>(&self, first: V, active: V) -> Strip<V> {
        let width = self.width(first, active);
        let at = Invariants::of_squares(first, width);
        let [stress, across, along, cross, lateral] = self.derivatives(&at, first, width, active);
        let guarded = lateral.max(active.constant(1e-6));
        Strip {
            stress,
            stiffness: along - cross * cross * guarded.recip(),
            across,
            lateral,
            at,
        }
    }

    /// Returns the state without stress, which has equal stretches: the fixed point of the natural width.
    #[inline(always)]
    fn unloaded<V: Value>(&self, active: V) -> Invariants<V> {
        let mut x = active.constant(1.0);
        for _ in 0..FIXED_POINT_STEPS {
            x = self.width(x, active);
        }
        Invariants::of_squares(x, x)
    }

    /// [`TensionField::strip`], compiled once.
    #[inline(never)]
    fn strip_out_of_line<V: Value>(&self, first: V, active: V) -> Strip<V> {
        active.out_of_line(StripAt {
            field: self,
            first,
            active,
        })
    }

    /// Returns the slopes of a wrinkled membrane, with the residual of the flat potential.
    #[inline(always)]
    fn relaxed<V: Value>(
        &self,
        at: &Invariants<V>,
        principal: &Principal<V>,
        strip: &Strip<V>,
        active: V,
    ) -> Slopes<V> {
        let number = |value: f64| active.constant(value);
        let zero = number(0.0);
        let x = principal.first;
        let inverse = x.sqrt().recip();
        // Slack membrane has neither stress nor stiffness.
        let stress = strip.stress.max(zero);
        let stiffness = strip.stress.choose(strip.stiffness, zero);
        let eta = number(0.5) * stress * inverse;
        let change = number(0.25) * inverse * inverse * (stiffness - stress * inverse);
        let r = principal.gap.max(number(SMALLEST_GAP)).recip();
        let (share, area) = (x * r, at.area * r);
        let i = (at.shear + at.area + at.area) * r;
        let bend = number(8.0) * eta * r;
        let along = (eta + eta) * share;
        let across = -((eta + eta) * area);
        let Rest { i: rest_i, j: rest_j } = self.flat.rest();
        let relaxed = Slopes {
            pressure: along + across - number(rest_i + rest_j),
            i: along,
            j: across - number(rest_j),
            ii: (number(4.0) * change * share).madd(share, -(bend * area * area)),
            ij: (number(-4.0) * change * share).madd(area, number(0.5) * bend * area * i),
            jj: (number(4.0) * change * area).madd(area, number(-0.25) * bend * i * i),
        };
        let blend = relaxed.scaled(number(1.0 - RESIDUAL)) + principal.slopes.scaled(number(RESIDUAL));
        Slopes::choose(principal.compression, blend, principal.slopes)
    }
}

struct StripAt<'a, P, V> {
    field: &'a TensionField<P>,
    first: V,
    active: V,
}

impl<P: Potential, V: Value> WithSimd for StripAt<'_, P, V> {
    type Output = Strip<V>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Strip<V> {
        self.field.strip(self.first, self.active)
    }
}

impl<P: Potential> Potential for TensionField<P> {
    const SEVERAL_BRANCHES: bool = P::SEVERAL_BRANCHES;
    const WRINKLES: bool = true;

    #[inline(always)]
    fn energy<V: Value>(&self, at: &Invariants<V>, active: V) -> V {
        let principal = self.principal(at, active);
        let flat = self.flat.energy(at, active);
        if !principal.compression.any_positive() {
            return flat;
        }
        let strip = self.strip_out_of_line(principal.first, active);
        let relaxed = strip.stress.choose(
            self.flat.energy(&strip.at, active),
            self.flat.energy(&self.unloaded(active), active),
        );
        let share = active.constant(RESIDUAL);
        principal.compression.choose(share.madd(flat - relaxed, relaxed), flat)
    }

    #[inline(always)]
    fn slopes<V: Value>(&self, at: &Invariants<V>, active: V) -> Slopes<V> {
        let principal = self.principal(at, active);
        if !principal.compression.any_positive() {
            return principal.slopes;
        }
        let strip = self.strip_out_of_line(principal.first, active);
        self.relaxed(at, &principal, &strip, active)
    }

    fn rest(&self) -> Rest {
        self.flat.rest()
    }

    #[inline(always)]
    fn admissible<V: Value>(&self, at: &Invariants<V>) -> V {
        self.flat.admissible(at)
    }

    #[inline(always)]
    fn natural_width<V: Value>(&self, first: V, active: V) -> [V; 2] {
        self.flat.natural_width(first, active)
    }

    fn width_steps(&self) -> u32 {
        self.flat.width_steps()
    }

    fn load(&self) -> f64 {
        self.flat.load()
    }

    fn softening(&self) -> f64 {
        self.flat.softening()
    }

    #[inline(always)]
    fn margin_terms<V: Value>(&self, at: &Invariants<V>, active: V) -> MarginTerms<V> {
        let principal = self.principal(at, active);
        let taut = MarginTerms::taut(principal.slopes, active);
        let folds = principal.compression;
        if !folds.any_positive() {
            return taut;
        }
        let strip = self.strip_out_of_line(principal.first, active);
        let missed = active.constant(WIDTH_TOLERANCE) - strip.across.max(-strip.across);
        // In slack membrane the residual of the flat potential is not checked.
        let is_slack = strip.stress.choose(taut.is_slack, active.constant(1.0));
        MarginTerms {
            slopes: self.relaxed(at, &principal, &strip, active),
            bound: folds.choose(strip.lateral.min(missed), taut.bound),
            tension: folds.choose(strip.stress, taut.tension),
            is_slack: folds.choose(is_slack, taut.is_slack),
        }
    }
}

#[cfg(test)]
mod tests;
