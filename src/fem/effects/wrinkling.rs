//! Wrinkling by tension-field theory: a membrane that folds instead of bearing compression.
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
//! The natural width w of the ideal neo-Hookean dielectric is λ₁^(−½)(1 − κλ₁²)^(−¼) in total stretches. Other potentials
//! take Newton steps on the nearly linear l₂³φ₂ as a function of l₂⁴, kept between bounds; from below by the width without
//! voltage, which is that of uniaxial tension, λ₁^(−½), for every law. In the wrinkled branch φ is a
//! function of x₁ = l₁² alone; with D = x₁ − x₂, η = P₁/2l₁ and η′ = dη/dx₁
//!
//! ```text
//! φᵢ  = η x₁/D,                    φⱼ  = −2ηj/D,
//! φᵢᵢ = η′x₁²/D² − 2ηj²/D³,        φᵢⱼ = −2η′x₁j/D² + 2ηij/D³,       φⱼⱼ = 4η′j²/D² − 2ηi²/D³,
//! dP₁/dl₁ = φ₁₁ − φ₁₂²/φ₂₂
//! ```
//!
//! Ellipticity is lost where dP₁/dl₁ = 0 (Zurlo, arXiv 1908.06690, calls it the tension-extension inequality), at the latest
//! where there is no natural width: κλ₁² = 1.
//!
//! A share [`RESIDUAL`] of the flat potential is left to wrinkled and slack membrane, so that displacements across wrinkles
//! stay determined and elements do not turn over. It vanishes where wrinkling begins, as does its slope.

use pulp::{Simd, WithSimd};

use crate::fem::energy::{Invariants, Potential, Rest, Slopes, slopes_apart};
use crate::fem::lanes::Value;

/// The share of the flat potential in wrinkled membrane.
pub const RESIDUAL: f64 = 1e-3;
/// Gaps between squared stretches below this are rounding.
const SMALLEST_GAP: f64 = 1e-12;
/// Compression below this is rounding.
const SMALLEST_COMPRESSION: f64 = 1e-12;
/// A relative change of the squared width after which one Newton step more is exact, and that rounding to single precision
/// stays below.
const SETTLED: f64 = 1e-5;
/// The square of a width beyond any real one.
const LARGEST_WIDTH: f64 = 1e12;
/// Stress across at the natural width that rounding and the last Newton step may leave.
const WIDTH_TOLERANCE: f64 = 1e-4;

/// The natural width falls with about the root of the length, so each step halves the error at least.
const FIXED_POINT_STEPS: u32 = 60;

/// A potential without compression.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TensionField<P> {
    flat: P,
}

/// Principal stretches and what the flat potential says of them.
struct Principal<V> {
    /// x₁ and x₁ − x₂.
    first: V,
    gap: V,
    /// Negative of φ₂: positive where the membrane wrinkles.
    compression: V,
    slopes: Slopes<V>,
}

/// The strip of natural width.
struct Strip<V> {
    /// P₁ and dP₁/dl₁.
    stress: V,
    stiffness: V,
    /// φ₂ and φ₂₂ at what was found to be the natural width.
    across: V,
    lateral: V,
    at: Invariants<V>,
}

impl<P: Potential> TensionField<P> {
    /// The relaxation of a potential.
    #[must_use]
    pub fn new(flat: P) -> Self {
        Self { flat }
    }

    #[inline(always)]
    fn principal<V: Value>(&self, at: &Invariants<V>, active: V) -> Principal<V> {
        let slopes = slopes_apart(&self.flat, at, active);
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

    /// φ₁, φ₂, φ₁₁, φ₁₂ and φ₂₂ at squared stretches.
    #[inline(always)]
    fn derivatives<V: Value>(&self, at: &Invariants<V>, first: V, second: V, active: V) -> [V; 5] {
        let s = slopes_apart(&self.flat, at, active);
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

    /// The square of the natural width at x₁: Newton steps on l₂³φ₂ as a function of l₂⁴, between bounds, until they have
    /// settled in all lanes, and one more.
    #[inline(always)]
    fn width<V: Value>(&self, first: V, active: V) -> V {
        let [mut low, mut x] = self.flat.natural_width(first, active);
        let (one, four) = (active.constant(1.0), active.constant(4.0));
        let mut high = active.constant(LARGEST_WIDTH);
        let mut settled = false;
        for _ in 0..self.flat.width_steps() {
            let at = Invariants::of_squares(first, x);
            let [_, across, _, _, lateral] = self.derivatives(&at, first, x, active);
            // Where the potential is infinite the stretch is too large.
            let inside = self.flat.admissible(&at);
            let excess = inside.choose(across, one);
            high = excess.choose(x, high);
            low = excess.choose(low, x);
            let two = x.sqrt();
            let slope = (active.constant(3.0) * across).madd(two.recip(), lateral);
            let square = x.madd(x, -(four * across * x * two * slope.recip()));
            let newton = square.max(active.constant(0.0)).sqrt();
            // A step that rounding alone carries out of bounds is a good one.
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

    /// The state without stress, which is as wide as it is long: the fixed point of the natural width.
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
    fn strip_apart<V: Value>(&self, first: V, active: V) -> Strip<V> {
        active.apart(StripAt {
            field: self,
            first,
            active,
        })
    }

    #[inline(always)]
    fn relaxed<V: Value>(&self, at: &Invariants<V>, principal: &Principal<V>, active: V) -> Slopes<V> {
        let strip = self.strip_apart(principal.first, active);
        let number = |value: f64| active.constant(value);
        let zero = number(0.0);
        let x = principal.first;
        let inverse = x.sqrt().recip();
        // A slack membrane has neither stress nor stiffness.
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
        Slopes {
            pressure: along + across - number(rest_i + rest_j),
            i: along,
            j: across - number(rest_j),
            ii: (number(4.0) * change * share).madd(share, -(bend * area * area)),
            ij: (number(-4.0) * change * share).madd(area, number(0.5) * bend * area * i),
            jj: (number(4.0) * change * area).madd(area, number(-0.25) * bend * i * i),
        }
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
        let strip = self.strip_apart(principal.first, active);
        let flat = self.flat.energy(at, active);
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
        let relaxed = self.relaxed(at, &principal, active);
        let blend =
            relaxed.scaled(active.constant(1.0 - RESIDUAL)) + principal.slopes.scaled(active.constant(RESIDUAL));
        Slopes::choose(principal.compression, blend, principal.slopes)
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
    fn tension<V: Value>(&self, at: &Invariants<V>, active: V) -> V {
        let principal = self.principal(at, active);
        let strip = self.strip_apart(principal.first, active);
        principal.compression.choose(strip.stress, active.constant(1.0))
    }

    #[inline(always)]
    fn ellipticity<V: Value>(&self, least: V, at: &Invariants<V>, active: V) -> V {
        let principal = self.principal(at, active);
        let strip = self.strip_apart(principal.first, active);
        let missed = active.constant(WIDTH_TOLERANCE) - strip.across.max(-strip.across);
        let width = strip.lateral.min(missed);
        // What is left of the flat potential in slack membrane says nothing.
        let relaxed = strip.stress.choose(least.min(width), width);
        principal.compression.choose(relaxed, least)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::effects::{Decaying, Stiff};
    use crate::fem::energy::{Compound, Elasticity, FirstInvariant, Isotropic, Law, Neo, Stiffening, gent};

    fn field<M: Elasticity>(prestretch: f64, kappa: f64, elasticity: M) -> TensionField<Compound<M>> {
        let dielectric = Decaying::ideal(prestretch, kappa);
        TensionField::new(Compound::new(prestretch, elasticity, dielectric, Stiff { ratio: 0.0 }))
    }

    fn stiff(jm: f64, prestretch: f64) -> Stiffening {
        Stiffening::FirstInvariant(FirstInvariant::new(gent(jm), prestretch).unwrap())
    }

    #[test]
    fn a_wrinkled_strip_has_the_closed_form_width_energy_and_stress() {
        // H11 at λ₁ = 1.5: w = λ₁^(−½)(1 − κλ₁²)^(−¼), W = ½μ(λ₁² + 2λ₁⁻¹s − 3), P₁ = μ(λ₁ − λ₁⁻²s − κ/s), s = √(1 − κλ₁²).
        for (kappa, width, energy, stress) in [
            (0.1, 0.870_219_768_6, 0.211_893_895_39, 0.995_145_036_2),
            (0.0, 0.816_496_580_9, 0.291_666_666_67, 1.055_555_555_56),
        ] {
            let neo = field(1.0, kappa, Neo::new(1.0));
            let nearly_neo = field(1.0, kappa, stiff(1e13, 1.0));
            let strips = [neo.strip(2.25, 1.0), nearly_neo.strip(2.25, 1.0)];
            let energies = [
                neo.flat.energy(&strips[0].at, 1.0),
                nearly_neo.flat.energy(&strips[1].at, 1.0),
            ];
            for (strip, found) in strips.iter().zip(energies) {
                assert!((strip.at.area / 1.5 - width).abs() < 1e-10);
                assert!((found - energy).abs() < 1e-10, "{found}");
                assert!((strip.stress - stress).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn natural_widths_of_stiffening_membranes_are_found() {
        for (jm, kappa) in [(30.0, 0.05), (30.0, 0.4), (8.0, 0.02), (8.0, 1.0), (70.0, 0.01)] {
            let field = field(1.5, kappa, stiff(jm, 1.5));
            for step in 0..30 {
                let first = 0.9 + 0.1 * f64::from(step);
                let inside = |x: f64| field.flat.admissible(&Invariants::of_squares(first, x)) > 0.0;
                let [uniaxial, _] = field.flat.natural_width(first, 1.0);
                if inside(uniaxial) {
                    let strip = field.strip(first, 1.0);
                    let across = strip.across.abs();
                    assert!(across < 1e-10 * strip.lateral, "{jm} {kappa} {first}: {across:e}");
                    assert!(inside(strip.at.area * strip.at.area / first));
                }
            }
        }
    }

    #[test]
    fn stress_is_continuous_from_taut_to_wrinkled_to_slack() {
        let law = Isotropic::new(field(1.2, 0.1, Neo::new(1.2)));
        let flat = law.potential.flat;
        let stress = |l1: f64, l2: f64| law.stress([[l1 - 1.0, 0.0], [0.0, l2 - 1.0]], 1.0);
        let gap = |a: [[f64; 2]; 2], b: [[f64; 2]; 2]| {
            (0..4)
                .map(|i| (a[i / 2][i % 2] - b[i / 2][i % 2]).abs())
                .fold(0.0, f64::max)
        };
        let width = flat.natural_width(1.1 * 1.1, 1.0)[1].sqrt();
        assert!(gap(stress(1.1, width * (1.0 + 1e-9)), stress(1.1, width * (1.0 - 1e-9))) < 1e-7);
        let unloaded = law.potential.unloaded(1.0).area.sqrt();
        let loose = |by: f64| stress(unloaded * (1.0 + by), 0.9 * unloaded);
        assert!(gap(loose(1e-9), loose(-1e-9)) < 1e-7);
        assert!(gap(loose(1e-3), loose(-1e-3)) > 1e-4);
    }

    #[test]
    fn a_strip_loses_ellipticity_where_its_tension_falls_with_its_length() {
        // dP₁/dλ₁ = 1 + 2λ₁⁻³s + κλ₁⁻¹/s − κ²λ₁/s³; at κ = 0.16 there is no natural width from λ₁ = 2.5 on.
        let kappa = 0.16;
        let law = Isotropic::new(field(1.0, kappa, Neo::new(1.0)));
        for step in 0..40 {
            let l1 = 1.3 + 0.04 * f64::from(step);
            let s = (1.0 - kappa * l1 * l1).sqrt();
            let slope = 1.0 + 2.0 * l1.powi(-3) * s + kappa / l1 / s - kappa * kappa * l1 / s.powi(3);
            let margin = law.ellipticity([[l1, 0.0], [0.0, 0.45]], 1.0);
            assert_eq!(margin > 0.0, slope > 0.0, "{l1}: {margin} {slope}");
        }
    }
}
