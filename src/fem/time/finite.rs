//! The finite viscous law at a point: an incompressible neo-Hookean branch that flows with its deviatoric stress
//! (Reese, Govindjee, Int. J. Solids Struct. 35 (1998) 3455).
//!
//! With be = f A fᵀ in three dimensions the flow is L_v be = −dev(be) be/τ. In B = A⁻¹ it is linear except for one
//! number, which keeps det B at 1 (Shutov, Landgraf, Ihlemann, Comput. Methods Appl. Mech. Eng. 265 (2013) 213):
//!
//! ```text
//! Ḃ = (C − m B)/τ,   m = tr(C B⁻¹)/3
//! ```
//!
//! A step is the exponential trapezoid of this equation, with r = Δt/τ and the coefficients E, c₀ and c₁ of m r:
//!
//! ```text
//! B₁ = E B₀ + (c₀ C₀ + c₁ C₁)/m,   m such that det B₁ = 1
//! ```
//!
//! B₁ is positive definite at any r. ln det B₁ is convex and falls with m, and is not negative at m = 1: Newton's
//! iteration from there neither overshoots nor fails. At small strains m − 1 is of second order, and the step is that
//! of the linear law.

use super::coefficients::Coefficients;
use crate::memory::NUMBERS;

/// A symmetric tensor: the components xx, xy and yy, and the one across the membrane.
type Symmetric = [f64; NUMBERS];

/// Largest number of iterations for m; a few are enough.
const LIMIT: usize = 60;
/// A change after which the next change of Newton's iteration is rounding.
const LAST: f64 = 1e-8;
/// Relaxation times after which the branch has relaxed.
const OVER: f64 = 50.0;

/// A step of a branch.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Δt/τ.
    r: f64,
    /// The coefficients at m = 1.
    first: Coefficients,
}

impl Step {
    /// Returns a step over `r` relaxation times.
    #[must_use]
    pub fn new(r: f64) -> Self {
        Self {
            r,
            first: Coefficients::new(r),
        }
    }

    /// Returns A at the end of a step in which C⁻¹ goes from one value to another, and c₁/m.
    #[must_use]
    pub fn end(&self, state: Symmetric, from: Symmetric, to: Symmetric) -> (Symmetric, f64) {
        let Self { r, first } = *self;
        if r <= 0.0 {
            return (state, 0.0);
        }
        let parts = [inverse(state), inverse(from), inverse(to)];
        let mut m = 1.0;
        let mut coefficients = first;
        let mut iterations = 0;
        loop {
            let Coefficients { kept, before, now } = coefficients;
            let b = sum([kept, before / m, now / m], &parts);
            let slope = sum(
                [-r * kept, (r * kept - 2.0 * before / m) / m, (before - now) / (m * m)],
                &parts,
            );
            let next = f64::max(1.0, m - determinant(b).ln() / product(inverse(b), slope));
            let change = next - m;
            iterations += 1;
            if change.abs() * r.min(1.0) <= LAST * m || iterations == LIMIT {
                let b = sum([1.0, change], &[b, slope]);
                return (unimodular(inverse(b)), now / m);
            }
            m = next;
            coefficients = Coefficients::new(m * r);
        }
    }
}

/// Returns A after `r` relaxation times at constant C⁻¹.
///
/// There B runs along a line, B ∝ q B₀ + (1 − q) C with q = e^(−y), and dy/dr = det(q B₀ + (1 − q) C)^⅓ ≥ 1 says when
/// it is where.
#[must_use]
pub fn relaxed(state: Symmetric, metric: Symmetric, r: f64) -> Symmetric {
    if r <= 0.0 {
        return state;
    }
    if r >= OVER {
        return metric;
    }
    let parts = [inverse(state), inverse(metric)];
    let at = |y: f64| sum([(-y).exp(), -(-y).exp_m1()], &parts);
    let pace = |y: f64| determinant(at(y)).cbrt();
    // The integrand has its zeros before y = 0 by at least the smallest eigenvalue of B₀ in terms of C, and π away from
    // the axis.
    let room = eigenvalues(state, metric)[1].recip();
    let (mut y, mut left) = (0.0, r);
    loop {
        let width = 0.5 * f64::min(y + room, std::f64::consts::PI);
        let whole = time(&pace, y, width);
        if left <= whole {
            break;
        }
        (y, left) = (y + width, left - whole);
    }
    let mut width = left * pace(y);
    for _ in 0..LIMIT {
        let change = (left - time(&pace, y, width)) * pace(y + width);
        width += change;
        if change.abs() <= LAST * (y + width) {
            break;
        }
    }
    let b = at(y + width);
    let scale = determinant(b).cbrt();
    unimodular(inverse(b).map(|number| scale * number))
}

/// Returns the smallest eigenvalue of C A.
#[must_use]
pub fn least(state: Symmetric, metric: Symmetric) -> f64 {
    eigenvalues(state, metric)[0]
}

/// Returns the integral of 1/pace over a width, by Gauss's rule with six points.
fn time(pace: &impl Fn(f64) -> f64, from: f64, width: f64) -> f64 {
    const RULE: [(f64, f64); 3] = [
        (0.932_469_514_203_152, 0.171_324_492_379_170_36),
        (0.661_209_386_466_264_5, 0.360_761_573_048_138_6),
        (0.238_619_186_083_196_9, 0.467_913_934_572_691),
    ];
    let half = 0.5 * width;
    let middle = from + half;
    let pairs = RULE.map(|(place, weight)| {
        let offset = place * half;
        weight * (pace(middle - offset).recip() + pace(middle + offset).recip())
    });
    half * pairs.iter().sum::<f64>()
}

/// Returns the smallest and the largest eigenvalue of C A, from A and C⁻¹.
fn eigenvalues(state: Symmetric, metric: Symmetric) -> [f64; 2] {
    let c = inverse(metric);
    let across = state[3] * c[3];
    let half = 0.5 * (product(state, c) - across);
    let flat = |[xx, xy, yy, _]: Symmetric| xx * yy - xy * xy;
    let square = flat(state) * flat(c);
    let largest = half + (half * half - square).max(0.0).sqrt();
    [across.min(square / largest), across.max(largest)]
}

/// Returns the tensor with the component across that makes its determinant 1.
fn unimodular([xx, xy, yy, _]: Symmetric) -> Symmetric {
    [xx, xy, yy, (xx * yy - xy * xy).recip()]
}

fn determinant([xx, xy, yy, across]: Symmetric) -> f64 {
    (xx * yy - xy * xy) * across
}

fn inverse([xx, xy, yy, across]: Symmetric) -> Symmetric {
    let scale = (xx * yy - xy * xy).recip();
    [yy * scale, -xy * scale, xx * scale, across.recip()]
}

/// Returns a : b.
fn product(a: Symmetric, b: Symmetric) -> f64 {
    a[0] * b[0] + 2.0 * a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

fn sum<const N: usize>(weights: [f64; N], parts: &[Symmetric; N]) -> Symmetric {
    std::array::from_fn(|number| {
        let pairs = weights.iter().zip(parts);
        pairs.map(|(weight, part)| weight * part[number]).sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// C⁻¹ of a sheet with the stretch λ along both sides.
    fn sheet(stretch: f64) -> Symmetric {
        [stretch.powi(-2), 0.0, stretch.powi(-2), stretch.powi(4)]
    }

    /// C⁻¹ of f, in plane stress.
    fn metric([[a, b], [c, d]]: [[f64; 2]; 2]) -> Symmetric {
        let j = a * d - b * c;
        inverse([a * a + c * c, a * b + c * d, b * b + d * d, j.powi(-2)])
    }

    const FRESH: Symmetric = [1.0, 0.0, 1.0, 1.0];

    /// The stress of a branch in a sheet of stretch λ, in units of G.
    fn stress(state: Symmetric, stretch: f64) -> f64 {
        state[0] * stretch.powi(2) - state[3] * stretch.powi(-4)
    }

    /// Relaxed states of a frame at λ = 3 (design of time, section 5): t/τ and σ/G.
    const FRAME: [(f64, f64); 3] = [(0.1, 6.905_621_897_2), (1.0, 2.109_150_628_8), (3.0, 0.402_068_668_4)];

    #[test]
    fn a_branch_relaxes_in_a_fixed_frame_as_it_should() {
        for (r, known) in FRAME {
            let once = relaxed(FRESH, sheet(3.0), r);
            assert!((stress(once, 3.0) - known).abs() < 1e-9, "{r}: {}", stress(once, 3.0));
            let parts = (0..7).fold(FRESH, |state, _| relaxed(state, sheet(3.0), r / 7.0));
            assert!((stress(parts, 3.0) - known).abs() < 1e-9, "{r}: {}", stress(parts, 3.0));
        }
        assert_eq!(relaxed(FRESH, sheet(3.0), 1e9), sheet(3.0));
        assert!((relaxed(FRESH, sheet(3.0), 49.9)[3] / 81.0 - 1.0).abs() < 1e-12);
        // Far from the metric and skew.
        let (state, to) = (metric([[0.2, 0.1], [0.0, 6.0]]), metric([[1.3, -0.4], [0.5, 0.7]]));
        let once = relaxed(state, to, 2.0);
        let parts = (0..1000).fold(state, |state, _| relaxed(state, to, 2e-3));
        for (a, b) in once.iter().zip(parts) {
            assert!((a - b).abs() < 1e-9 * once[3].max(1.0), "{once:?} {parts:?}");
        }
    }

    #[test]
    fn steps_in_a_fixed_frame_are_of_second_order() {
        for (r, known) in FRAME {
            let [coarse, middle, fine] = [64, 128, 256].map(|count| {
                let step = Step::new(r / f64::from(count));
                let end = (0..count).fold(FRESH, |state, _| step.end(state, sheet(3.0), sheet(3.0)).0);
                stress(end, 3.0)
            });
            let slope = ((coarse - known) / (middle - known)).log2();
            assert!((slope - 2.0).abs() < 0.05, "{r}: {slope}");
            assert!((fine + (fine - middle) / 3.0 - known).abs() < 1e-5, "{r}: {fine}");
        }
    }

    /// A free sheet without prestretch, G/μ = 2 and κ = 0.4, at these times in units of τ, with a number of steps
    /// between each two.
    fn creep(times: &[f64], count: u32) -> Vec<f64> {
        let g = 2.0;
        let equilibrium = |known: Symmetric, mut l: f64| {
            for _ in 0..100 {
                let force = l * (1.0 + g * known[0]) - (1.0 + g * known[3]) * l.powi(-5) - 0.4 * l.powi(3);
                let slope = 1.0 + g * known[0] + 5.0 * (1.0 + g * known[3]) * l.powi(-6) - 1.2 * l * l;
                l -= force / slope;
            }
            l
        };
        let mut l = equilibrium(FRESH, 1.0);
        let mut state = FRESH;
        let mut reached = Vec::new();
        for pair in times.windows(2) {
            let step = Step::new((pair[1] - pair[0]) / f64::from(count));
            for _ in 0..count {
                let start = l;
                for _ in 0..25 {
                    let end = step.end(state, sheet(start), sheet(l)).0;
                    l = equilibrium(end, l);
                }
                state = step.end(state, sheet(start), sheet(l)).0;
            }
            reached.push(l);
        }
        reached
    }

    #[test]
    fn a_free_sheet_creeps_as_it_should() {
        let times = [0.0, 0.1, 1.0, 3.0, 10.0];
        // The second to all digits of the design of time; the others by Runge and Kutta's method.
        let known = [1.027_354_02, 1.042_465_087_757, 1.067_796_25, 1.108_276_99];
        let [coarse, fine] = [500, 1000].map(|count| creep(&times, count));
        for (at, known) in known.into_iter().enumerate() {
            let found = fine[at] + (fine[at] - coarse[at]) / 3.0;
            let digits = if at == 1 { 1e-11 } else { 6e-9 };
            assert!((found - known).abs() < digits, "{found} {known}");
        }
        let errors = [10, 20].map(|count| creep(&times[1..3], count)[0]);
        let finer = creep(&times[1..3], 640)[0];
        let slope = ((errors[0] - finer) / (errors[1] - finer)).log2();
        assert!((slope - 2.0).abs() < 0.02, "{slope}");
    }

    #[test]
    fn steps_of_any_length_keep_the_volume_and_lose_energy() {
        let places = [
            [[1.0, 0.0], [0.0, 1.0]],
            [[3.0, 0.1], [-0.2, 3.0]],
            [[0.3, 1.5], [-1.4, 0.4]],
            [[0.15, 0.0], [0.0, 5.0]],
        ]
        .map(metric);
        for from in places {
            for state in places {
                for exponent in -18..=18 {
                    let r = 10.0_f64.powi(exponent);
                    for to in places {
                        let (end, share) = Step::new(r).end(state, from, to);
                        assert!(end.iter().all(|number| number.is_finite()), "{r}: {end:?}");
                        assert!((determinant(end) - 1.0).abs() < 1e-10 && least(end, to) > 0.0);
                        assert!((0.0..=1.0).contains(&share), "{share}");
                        if exponent == 18 {
                            assert!(end.iter().zip(to).all(|(a, b)| (a - b).abs() < 1e-9 * b.abs().max(1.0)));
                        }
                    }
                    // At constant strain no energy is supplied.
                    let before = product(state, inverse(from));
                    for end in [Step::new(r).end(state, from, from).0, relaxed(state, from, r)] {
                        let after = product(end, inverse(from));
                        assert!(after <= before * (1.0 + 1e-10), "{r}: {before} {after}");
                    }
                }
            }
        }
    }

    #[test]
    fn small_strains_follow_the_linear_law() {
        let size = 1e-4;
        let [state, from, to] = [
            [[1.0 + size, 0.0], [0.0, 1.0]],
            [[1.0, size], [0.0, 1.0 - size]],
            [[1.0 - size, 0.0], [size, 1.0]],
        ]
        .map(metric);
        for r in [1e-2, 1.0, 1e2] {
            let Coefficients { kept, before, now } = Coefficients::new(r);
            let (end, share) = Step::new(r).end(state, from, to);
            let linear = sum([kept, before, now], &[state, from, to]);
            assert!((share - now).abs() < 1e-6);
            assert!(end.iter().zip(linear).all(|(a, b)| (a - b).abs() < 10.0 * size * size));
        }
    }
}
