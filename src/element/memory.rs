//! An energy in addition to that of the material, with separate coefficients at each quadrature point.
//!
//! ```text
//! w  += ½ (P : c + P₃₃ j⁻²),   c = fᵀf
//! p  += f P − P₃₃ j⁻³ cof f
//! dp += df P + P₃₃ [3 j⁻⁴ (cof f : df) cof f − j⁻³ cof df]
//! ```
//!
//! At one time, viscoelastic branches of any number add just this energy: P is the sum over the branches.

use std::ops::Range;

use crate::registers::dispatch;

use super::energy::MODULI;
use super::kinematics::{
    Tensor, add_scaled, cofactor, contract, deformation, determinant, times_transposed, transposed,
};
use super::lanes::Value;
use super::layout::NodeLayout;
use super::precision::{BothPrecisions, Precision};

/// Numbers at a point: P along xx, xy and yy, and P₃₃.
pub const NUMBERS: usize = 4;

/// Number of partial sums; rows are padded to a multiple of it.
const PARTIAL_SUMS: usize = 8;

/// Number of moduli that determine the tangent of a material with memory at a given deformation: 2φᵢ + P along xx, xy
/// and yy, then φⱼ − P₃₃ j⁻³, 4φᵢᵢ, 2φᵢⱼ and φⱼⱼ + 3 P₃₃ j⁻⁴.
pub const MODULI_WITH_MEMORY: usize = 7;

/// The coefficients at all quadrature points.
#[derive(Clone, Debug, PartialEq)]
pub struct Memory {
    values: BothPrecisions,
    /// Largest absolute value.
    pub largest: f64,
    /// Mean of P₃₃, which a null Lagrangian can compensate.
    pub weight: f64,
}

impl Memory {
    /// Creates a memory from the numbers of all points, in lines as [`line()`].
    #[must_use]
    pub fn new(layout: NodeLayout, values: &[f64]) -> Self {
        let mut memory = Self::zeros(values.len());
        memory.refill(layout, |range, numbers| numbers.copy_from_slice(&values[range]));
        memory
    }

    /// Creates a memory with a number of zeros, to be filled.
    #[must_use]
    pub fn zeros(count: usize) -> Self {
        Self {
            values: BothPrecisions::zeros(count),
            largest: 0.0,
            weight: 0.0,
        }
    }

    /// Returns the total number of coefficients.
    #[must_use]
    pub fn count(&self) -> usize {
        self.values.double().len()
    }

    /// Rewrites all numbers, those of a row of elements at one point at a time: `fill` gets their index range and
    /// writes them. A single pass, because the numbers exceed the cache.
    #[inline(always)]
    pub fn refill(&mut self, layout: NodeLayout, mut fill: impl FnMut(Range<usize>, &mut [f64])) {
        let size = NUMBERS * layout.part();
        let (double, single) = self.values.parts_mut();
        let count = double.len() / size * layout.columns();
        let (mut largest, mut sum) = ([0.0_f64; PARTIAL_SUMS], [0.0; PARTIAL_SUMS]);
        dispatch(
            #[inline(always)]
            || {
                let rows = double.chunks_exact_mut(size).zip(single.chunks_exact_mut(size));
                for (at, (double, single)) in rows.enumerate() {
                    fill(at * size..(at + 1) * size, double);
                    for (narrow, value) in single.iter_mut().zip(&*double) {
                        *narrow = *value as f32;
                    }
                    for values in double.chunks_exact(PARTIAL_SUMS) {
                        for (largest, value) in largest.iter_mut().zip(values) {
                            let size = value.abs();
                            *largest = if size > *largest { size } else { *largest };
                        }
                    }
                    let normal = &double[(NUMBERS - 1) * layout.part()..][..layout.columns()];
                    let chunks = normal.chunks_exact(PARTIAL_SUMS);
                    let rest = chunks.remainder();
                    for values in chunks {
                        for (sum, value) in sum.iter_mut().zip(values) {
                            *sum += value;
                        }
                    }
                    for (sum, value) in sum.iter_mut().zip(rest) {
                        *sum += value;
                    }
                }
            },
        );
        self.largest = largest.into_iter().fold(0.0, f64::max);
        self.weight = sum.iter().sum::<f64>() / count as f64;
    }

    /// Returns the numbers in one precision.
    #[must_use]
    pub fn view<T: Precision>(&self) -> &[T] {
        T::of(&self.values)
    }
}

/// Returns the start of the line of a number at point `q` of `points` of a row of elements: one number per element.
#[inline(always)]
#[must_use]
pub fn line(layout: NodeLayout, points: usize, row: usize, q: usize, number: usize) -> usize {
    ((row * points + q) * NUMBERS + number) * layout.part()
}

/// Returns the lines of the numbers of a row of elements at a point.
#[inline(always)]
#[must_use]
pub fn lines(part: usize, row: &[f64]) -> [&[f64]; NUMBERS] {
    [
        &row[..part],
        &row[part..][..part],
        &row[2 * part..][..part],
        &row[3 * part..][..part],
    ]
}

/// Adds a share of P : c + P₃₃ j⁻² at each point, from P and from c⁻¹ and j² in rows of `part` elements.
pub fn add_energy(part: usize, [coefficients, metric]: [&[f64]; 2], share: f64, energy: &mut [f64]) {
    let rows = coefficients
        .chunks_exact(NUMBERS * part)
        .zip(metric.chunks_exact(NUMBERS * part))
        .zip(energy.chunks_exact_mut(part));
    dispatch(
        #[inline(always)]
        || {
            for ((coefficients, metric), energy) in rows {
                let [xx, xy, yy, normal] = lines(part, coefficients);
                let [ixx, ixy, iyy, square] = lines(part, metric);
                for at in 0..part {
                    let coefficients = [xx[at], xy[at], yy[at], normal[at]];
                    energy[at] += share * paired(coefficients, [ixx[at], ixy[at], iyy[at], square[at]]);
                }
            }
        },
    );
}

/// Adds a share of the difference of this energy between two metrics, for the sum of two sets of P.
pub fn add_work(part: usize, coefficients: [&[f64]; 2], metric: [&[f64]; 2], share: f64, work: &mut [f64]) {
    let size = NUMBERS * part;
    dispatch(
        #[inline(always)]
        || {
            for (row, work) in work.chunks_exact_mut(part).enumerate() {
                let row = row * size;
                let [xx, xy, yy, normal] = lines(part, &coefficients[0][row..]);
                let [other_xx, other_xy, other_yy, other_normal] = lines(part, &coefficients[1][row..]);
                let [ixx, ixy, iyy, square] = lines(part, &metric[0][row..]);
                let [later_xx, later_xy, later_yy, later_square] = lines(part, &metric[1][row..]);
                for at in 0..part {
                    let sum = [
                        xx[at] + other_xx[at],
                        xy[at] + other_xy[at],
                        yy[at] + other_yy[at],
                        normal[at] + other_normal[at],
                    ];
                    let after = share * paired(sum, [later_xx[at], later_xy[at], later_yy[at], later_square[at]]);
                    work[at] += after - share * paired(sum, [ixx[at], ixy[at], iyy[at], square[at]]);
                }
            }
        },
    );
}

/// Returns P : c + P₃₃ j⁻² from c⁻¹ and j².
#[inline(always)]
fn paired([xx, xy, yy, normal]: [f64; NUMBERS], [ixx, ixy, iyy, square]: [f64; NUMBERS]) -> f64 {
    let across = xx * iyy - 2.0 * xy * ixy + yy * ixx;
    square * across + normal / square
}

/// Returns the stress at f = I + ∇u.
#[inline(always)]
pub fn stress<V: Value>([xx, xy, yy, normal]: [V; NUMBERS], gradient: Tensor<V>) -> Tensor<V> {
    let f = deformation(gradient);
    let inverse = determinant(f).recip();
    let squeezed = -(normal * inverse * (inverse * inverse));
    add_scaled(times(f, [xx, xy, yy]), squeezed, cofactor(f))
}

/// Returns the mean stress of a step from f = I + ∇u to f + `df`; its work is the change of energy.
#[inline(always)]
pub fn stress_between<V: Value>([xx, xy, yy, normal]: [V; NUMBERS], gradient: Tensor<V>, df: Tensor<V>) -> Tensor<V> {
    let number = |value: f64| normal.constant(value);
    let middle = deformation(add_scaled(gradient, number(0.5), df));
    let (first, last) = (
        determinant(deformation(gradient)),
        determinant(deformation(add_scaled(gradient, number(1.0), df))),
    );
    let inverse = (first * last).recip();
    let squeezed = -(number(0.5) * normal * (first + last) * (inverse * inverse));
    add_scaled(times(middle, [xx, xy, yy]), squeezed, cofactor(middle))
}

/// Returns the derivative of the stress along `df`.
#[inline(always)]
pub fn tangent<V: Value>([xx, xy, yy, normal]: [V; NUMBERS], gradient: Tensor<V>, df: Tensor<V>) -> Tensor<V> {
    let f = deformation(gradient);
    let c = cofactor(f);
    let inverse = determinant(f).recip();
    let squeezed = normal * inverse * (inverse * inverse);
    let along = inverse.constant(3.0) * squeezed * inverse * contract(c, df);
    add_scaled(add_scaled(times(df, [xx, xy, yy]), along, c), -squeezed, cofactor(df))
}

/// Returns the derivative with respect to f of df : (tangent along `df`) for relaxed branches, which have P = c⁻¹ and
/// P₃₃ = j² at f. In terms of H = df f⁻¹ the tangent is S = H + Hᵀ + 2 tr H I, and H changes by −H δf f⁻¹.
#[inline(always)]
pub fn relaxed_tangent_derivative<V: Value>(gradient: Tensor<V>, df: Tensor<V>) -> Tensor<V> {
    let f = deformation(gradient);
    let inverse = determinant(f).recip();
    let zero = [[inverse.constant(0.0); 2]; 2];
    let back = add_scaled(zero, inverse, cofactor(f));
    let h = times_transposed(df, back);
    let two = inverse.constant(2.0);
    let trace = two * (h[0][0] + h[1][1]);
    let one = inverse.constant(1.0);
    let sum = add_scaled(h, one, transposed(h));
    let s = [[sum[0][0] + trace, sum[0][1]], [sum[1][0], sum[1][1] + trace]];
    // Hᵀ S f⁻ᵀ; S is symmetric.
    let product = times_transposed(transposed(h), s);
    add_scaled(zero, -two, times_transposed(product, transposed(back)))
}

/// Returns the moduli of [`MODULI_WITH_MEMORY`] from those of the material.
#[inline(always)]
pub fn moduli_with_memory<V: Value>(
    [i, j, ii, ij, jj]: [V; MODULI],
    [xx, xy, yy, normal]: [V; NUMBERS],
    gradient: Tensor<V>,
) -> [V; MODULI_WITH_MEMORY] {
    let inverse = determinant(deformation(gradient)).recip();
    let squeezed = normal * inverse * (inverse * inverse);
    let curvature = (inverse.constant(3.0) * squeezed).madd(inverse, jj);
    [i + xx, xy, i + yy, j - squeezed, ii, ij, curvature]
}

/// Returns the derivative of the stress along `df` from these moduli.
#[inline(always)]
pub fn tangent_from<V: Value>(
    gradient: Tensor<V>,
    [xx, xy, yy, j, ii, ij, jj]: [V; MODULI_WITH_MEMORY],
    df: Tensor<V>,
) -> Tensor<V> {
    let f = deformation(gradient);
    let c = cofactor(f);
    let (along, across) = (contract(f, df), contract(c, df));
    let (first, second) = (ii.madd(along, ij * across), ij.madd(along, jj * across));
    let direct = add_scaled(times(df, [xx, xy, yy]), j, cofactor(df));
    add_scaled(add_scaled(direct, first, f), second, c)
}

/// Returns lower bounds of its contributions to the margins of ellipticity and of convexity, without the null
/// Lagrangian of a weight: f P and cof df are bounded by the smaller eigenvalue of P and by |df|².
#[inline(always)]
pub fn margins<V: Value>([xx, xy, yy, normal]: [V; NUMBERS], weight: f64, f: Tensor<V>) -> [V; 2] {
    let half = xx.constant(0.5);
    let (mean, gap) = (half * (xx + yy), half * (xx - yy));
    let least = mean - gap.madd(gap, xy * xy).sqrt();
    let inverse = determinant(f).recip();
    let turned = (normal * inverse).madd(inverse * inverse, xx.constant(-weight));
    [least, least - turned.max(-turned)]
}

/// Returns f P. Not by `map`: its closure is a separate function without the registers of the kernel, and takes three
/// times as long.
#[inline(always)]
fn times<V: Value>([[a, b], [c, d]]: Tensor<V>, [xx, xy, yy]: [V; 3]) -> Tensor<V> {
    [
        [a.madd(xx, b * xy), a.madd(xy, b * yy)],
        [c.madd(xx, d * xy), c.madd(xy, d * yy)],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    const P: [f64; NUMBERS] = [0.9, 0.2, 1.3, 0.7];
    const GRADIENT: Tensor<f64> = [[0.12, 0.07], [-0.11, -0.07]];
    const ENTRIES: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

    fn energy(gradient: Tensor<f64>) -> f64 {
        let f = deformation(gradient);
        let [[a, b], [c, d]] = f;
        let metric = [a * a + c * c, a * b + c * d, b * b + d * d];
        0.5 * (P[0] * metric[0] + 2.0 * P[1] * metric[1] + P[2] * metric[2] + P[3] / determinant(f).powi(2))
    }

    fn nudged(i: usize, k: usize, by: f64) -> Tensor<f64> {
        let mut gradient = GRADIENT;
        gradient[i][k] += by;
        gradient
    }

    #[test]
    fn stress_and_tangent_are_derivatives_of_the_energy() {
        for (i, k) in ENTRIES {
            let (up, down) = (nudged(i, k, 1e-6), nudged(i, k, -1e-6));
            let slope = (energy(up) - energy(down)) / 2e-6;
            assert!((stress(P, GRADIENT)[i][k] - slope).abs() < 1e-9);
            let mut direction = [[0.0; 2]; 2];
            direction[i][k] = 1.0;
            let (high, low, along) = (stress(P, up), stress(P, down), tangent(P, GRADIENT, direction));
            for (r, c) in ENTRIES {
                assert!(((high[r][c] - low[r][c]) / 2e-6 - along[r][c]).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn the_work_of_a_step_is_the_change_of_energy() {
        let df = [[0.2, -0.1], [0.07, 0.15]];
        let change = energy(add_scaled(GRADIENT, 1.0, df)) - energy(GRADIENT);
        assert!((contract(stress_between(P, GRADIENT, df), df) - change).abs() < 1e-15);
    }

    #[test]
    fn relaxed_tangent_derivative_is_the_derivative() {
        let df = [[0.2, -0.1], [0.07, 0.15]];
        // df : (tangent along df) with P = c⁻¹ and P₃₃ = j².
        let value = |gradient: Tensor<f64>| {
            let f = deformation(gradient);
            let [[a, b], [c, d]] = f;
            let (xx, xy, yy) = (a * a + c * c, a * b + c * d, b * b + d * d);
            let square = determinant(f).powi(2);
            let relaxed = [yy / square, -xy / square, xx / square, square];
            contract(df, tangent(relaxed, gradient, df))
        };
        let slopes = relaxed_tangent_derivative(GRADIENT, df);
        for (i, k) in ENTRIES {
            let slope = (value(nudged(i, k, 1e-6)) - value(nudged(i, k, -1e-6))) / 2e-6;
            assert!((slopes[i][k] - slope).abs() < 1e-8, "{i}{k}: {} {slope}", slopes[i][k]);
        }
    }

    #[test]
    fn margins_are_lower_bounds_of_the_tangent() {
        let weight = 0.65;
        let [elliptic, convex] = margins(P, weight, deformation(GRADIENT));
        let mut smallest = [f64::INFINITY; 2];
        for trial in 0..20_000_i32 {
            let angle = |k: f64| (f64::from(trial) * k).sin();
            let d = [[angle(1.0), angle(2.3)], [angle(3.7), angle(5.9)]];
            let along = |d: Tensor<f64>| contract(d, tangent(P, GRADIENT, d)) / contract(d, d);
            smallest[1] = smallest[1].min(along(d) + 2.0 * weight * determinant(d) / contract(d, d));
            let rank_one = [
                [d[0][0] * d[1][0], d[0][0] * d[1][1]],
                [d[0][1] * d[1][0], d[0][1] * d[1][1]],
            ];
            smallest[0] = smallest[0].min(along(rank_one));
        }
        assert!(elliptic <= smallest[0] && convex <= smallest[1]);
        assert!(elliptic > 0.0 && convex > 0.5 * smallest[1], "{convex} {smallest:?}");
    }
}
