//! Two-by-two deformation gradients.
//!
//! f = I + ∇u is the gradient from the prestretched state, so F = λp f and J = λp² det f.

use super::lanes::Value;

/// A two-by-two tensor, `[row][column]`.
pub type Tensor<V> = [[V; 2]; 2];

/// f = I + ∇u from the displacement gradient.
#[inline(always)]
pub fn deformation<V: Value>(gradient: Tensor<V>) -> Tensor<V> {
    let [[a, b], [c, d]] = gradient;
    let one = a.constant(1.0);
    [[a + one, b], [c, d + one]]
}

/// Returns a deformation with given c⁻¹, along xx, xy and yy, and j². It is unique up to a rotation, which does not
/// matter for isotropic materials.
#[inline(always)]
#[must_use]
pub fn deformation_of_metric([xx, xy, yy, square]: [f64; 4]) -> Tensor<f64> {
    let [first, across] = [square * yy, -square * xy];
    let along = first.sqrt();
    debug_assert!(xx > 0.0);
    [[along, across / along], [0.0, square.sqrt() / along]]
}

/// det f.
#[inline(always)]
pub fn determinant<V: Value>(f: Tensor<V>) -> V {
    f[0][0].madd(f[1][1], -(f[0][1] * f[1][0]))
}

/// cof f = (det f) f⁻ᵀ; linear in f in two dimensions.
#[inline(always)]
pub fn cofactor<V: Value>(f: Tensor<V>) -> Tensor<V> {
    [[f[1][1], -f[1][0]], [-f[0][1], f[0][0]]]
}

/// a bᵀ.
#[inline(always)]
pub fn times_transposed<V: Value>([[a, b], [c, d]]: Tensor<V>, [[p, q], [r, s]]: Tensor<V>) -> Tensor<V> {
    [
        [a.madd(p, b * q), a.madd(r, b * s)],
        [c.madd(p, d * q), c.madd(r, d * s)],
    ]
}

/// aᵀ.
#[inline(always)]
pub fn transposed<V: Value>([[a, b], [c, d]]: Tensor<V>) -> Tensor<V> {
    [[a, c], [b, d]]
}

/// a : b.
#[inline(always)]
pub fn contract<V: Value>(a: Tensor<V>, b: Tensor<V>) -> V {
    let first = a[0][0].madd(b[0][0], a[0][1] * b[0][1]);
    first + a[1][0].madd(b[1][0], a[1][1] * b[1][1])
}

/// a + factor · b.
#[inline(always)]
pub fn add_scaled<V: Value>(a: Tensor<V>, factor: V, b: Tensor<V>) -> Tensor<V> {
    [
        [factor.madd(b[0][0], a[0][0]), factor.madd(b[0][1], a[0][1])],
        [factor.madd(b[1][0], a[1][0]), factor.madd(b[1][1], a[1][1])],
    ]
}

/// The squared singular values of f, larger first.
#[inline(always)]
pub fn squared_stretches<V: Value>(f: Tensor<V>) -> [V; 2] {
    let half = f[0][0].constant(0.5);
    let (conformal, anticonformal) = conformal_split(f);
    // With A and B the squared norms of the two parts, the stretches are (√A ± √B)/√2.
    let cross = (conformal * anticonformal).sqrt();
    let mean = half * (conformal + anticonformal);
    [mean + cross, (mean - cross).max(mean.constant(0.0))]
}

/// The squared norms of the conformal part of f (span of the identity and the quarter turn) and of its complement.
#[inline(always)]
pub fn conformal_split<V: Value>(f: Tensor<V>) -> (V, V) {
    let [[a, b], [c, d]] = f;
    let half = a.constant(0.5);
    let (p, q, r, s) = (a + d, c - b, a - d, c + b);
    (half * (p * p + q * q), half * (r * r + s * s))
}

#[cfg(test)]
mod tests {
    use super::*;

    const F: Tensor<f64> = [[1.3, 0.2], [-0.4, 0.9]];

    #[test]
    fn the_cofactor_is_the_derivative_of_the_determinant() {
        for i in 0..2 {
            for j in 0..2 {
                let (mut up, mut down) = (F, F);
                up[i][j] += 1e-6;
                down[i][j] -= 1e-6;
                let slope = (determinant(up) - determinant(down)) / 2e-6;
                assert!((slope - cofactor(F)[i][j]).abs() < 1e-9);
            }
        }
        assert!((contract(cofactor(F), F) - 2.0 * determinant(F)).abs() < 1e-15);
    }

    #[test]
    fn stretches_have_the_right_product_and_sum_of_squares() {
        let [large, small] = squared_stretches(F);
        assert!((large + small - contract(F, F)).abs() < 1e-14);
        assert!((large * small - determinant(F).powi(2)).abs() < 1e-14);
        assert!(large > small);
    }
}
