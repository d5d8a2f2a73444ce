//! Square elements: nodal values to gradients at the quadrature points, and stresses there to nodal forces.
//!
//! Nodes and points are numbered row by row. Order p has p + 1 Gauss points in each direction. They integrate det ∇u
//! exactly, so the null Lagrangian of the stability test vanishes in the discrete problem too.

use super::kinematics::Tensor;
use super::lanes::Value;

/// A square element of side 1 with N nodes and N quadrature points.
pub trait Element<const N: usize> {
    /// Polynomial degree.
    const DEGREE: usize;
    /// Weights of the quadrature points, which add up to 1. The forces contain them.
    const WEIGHTS: [f64; N];
    /// Returns the integrals of the products of two basis functions.
    fn masses() -> [[f64; N]; N];
    /// Returns the basis functions at the points, `[point][node]`.
    fn values() -> [[f64; N]; N];
    /// Returns ∇u at each point from the nodal values of both components.
    #[inline(always)]
    fn gradients<V: Value>(nodal: &[[V; N]; 2]) -> [Tensor<V>; N] {
        let mut gradients = [[[nodal[0][0]; 2]; 2]; N];
        Self::write_gradients(nodal, &mut gradients);
        gradients
    }
    /// Writes ∇u into a buffer: a new array per element costs a tenth of a solve where elements have many points.
    fn write_gradients<V: Value>(nodal: &[[V; N]; 2], gradients: &mut [Tensor<V>; N]);
    /// Returns Σ weight · stress : ∇N over the points, for each component and node.
    fn forces<V: Value>(stresses: &[Tensor<V>; N]) -> [[V; N]; 2];

    /// Returns the gradients on a rectangle: derivatives along x and y are those on the square times two factors, and
    /// an offset is added to the diagonal.
    #[inline(always)]
    fn gradients_on<V: Value>(nodal: &[[V; N]; 2], factors: [f64; 2], offset: [f64; 2]) -> [Tensor<V>; N] {
        let mut gradients = [[[nodal[0][0]; 2]; 2]; N];
        Self::write_gradients_on(nodal, factors, offset, &mut gradients);
        gradients
    }
    /// Writes the gradients on a rectangle into a buffer.
    fn write_gradients_on<V: Value>(
        nodal: &[[V; N]; 2],
        factors: [f64; 2],
        offset: [f64; 2],
        gradients: &mut [Tensor<V>; N],
    );

    /// Returns the forces on a rectangle with [`Element::gradients_on`], times its area: stresses along x and y are
    /// those on the square times two factors.
    fn forces_on<V: Value>(stresses: &[Tensor<V>; N], factors: [f64; 2]) -> [[V; N]; 2];
}

/// Four nodes and four points.
///
/// With the edge slopes d and the twist t of a component, ∂x u = d₀ + ηt and ∂y u = d₁ + ξt: one multiplication per
/// gradient.
pub struct Bilinear;

impl Element<4> for Bilinear {
    const DEGREE: usize = 1;
    const WEIGHTS: [f64; 4] = [0.25; 4];

    fn masses() -> [[f64; 4]; 4] {
        products(&Line::LINEAR)
    }

    fn values() -> [[f64; 4]; 4] {
        values(&Line::LINEAR)
    }

    #[inline(always)]
    fn write_gradients<V: Value>(nodal: &[[V; 4]; 2], gradients: &mut [Tensor<V>; 4]) {
        for (c, [lower_left, lower_right, upper_left, upper_right]) in nodal.iter().copied().enumerate() {
            let (along, across) = (lower_right - lower_left, upper_left - lower_left);
            let twist = upper_right - upper_left - along;
            slopes(gradients, c, [along, across], twist, [1.0; 2]);
        }
    }

    /// Factors and offset are applied to the slopes of edges, which are half as many as entries of gradients, and to
    /// the factors of the twist.
    #[inline(always)]
    fn write_gradients_on<V: Value>(
        nodal: &[[V; 4]; 2],
        [x, y]: [f64; 2],
        offset: [f64; 2],
        gradients: &mut [Tensor<V>; 4],
    ) {
        let number = |value: f64| nodal[0][0].constant(value);
        for (c, [lower_left, lower_right, upper_left, upper_right]) in nodal.iter().copied().enumerate() {
            let (along, across) = (lower_right - lower_left, upper_left - lower_left);
            let twist = upper_right - upper_left - along;
            let edges = match c {
                0 => [along.madd(number(x), number(offset[0])), across * number(y)],
                _ => [along * number(x), across.madd(number(y), number(offset[1]))],
            };
            slopes(gradients, c, edges, twist, [x, y]);
        }
    }

    /// Factors are applied to the weights of the sums over the edges.
    #[inline(always)]
    fn forces_on<V: Value>(stresses: &[Tensor<V>; 4], [x, y]: [f64; 2]) -> [[V; 4]; 2] {
        let number = |value: f64| stresses[0][0][0].constant(value);
        let [near, far] = Line::LINEAR.points;
        let (near, far) = (0.25 * near, 0.25 * far);
        let mut forces = [[number(0.0); 4]; 2];
        for (c, force) in forces.iter_mut().enumerate() {
            let [low, high, left, right] = edge_sums(stresses, c);
            let (along, across) = ((low + high) * number(0.25 * x), (left + right) * number(0.25 * y));
            let twist = right.madd(number(far * y), high * number(far * x));
            let twist = low.madd(number(near * x), left.madd(number(near * y), twist));
            *force = [twist - along - across, along - twist, across - twist, twist];
        }
        forces
    }

    #[inline(always)]
    fn forces<V: Value>(stresses: &[Tensor<V>; 4]) -> [[V; 4]; 2] {
        let mut forces = [[stresses[0][0][0]; 4]; 2];
        for (c, force) in forces.iter_mut().enumerate() {
            let [low, high, left, right] = edge_sums(stresses, c);
            *force = from_edges([low, high], [left, right]);
        }
        forces
    }
}

/// Returns the sums of the stresses of a component over the lower and upper edge along x, and over the left and right
/// edge along y.
#[inline(always)]
fn edge_sums<V: Value>(stresses: &[Tensor<V>; 4], c: usize) -> [V; 4] {
    let sum = |a: usize, b: usize, axis: usize| stresses[a][c][axis] + stresses[b][c][axis];
    [sum(0, 1, 0), sum(2, 3, 0), sum(0, 2, 1), sum(1, 3, 1)]
}

/// Writes the gradients of a component from the slopes of its lower and left edge and its twist times a factor for each
/// direction.
#[inline(always)]
fn slopes<V: Value>(gradients: &mut [Tensor<V>; 4], c: usize, [along, across]: [V; 2], twist: V, factors: [f64; 2]) {
    let [near, far] = Line::LINEAR.points;
    for (low, high, point) in [(0, 1, near), (2, 3, far)] {
        let slope = twist.madd(along.constant(factors[0] * point), along);
        gradients[low][c][0] = slope;
        gradients[high][c][0] = slope;
    }
    for (left, right, point) in [(0, 2, near), (1, 3, far)] {
        let slope = twist.madd(across.constant(factors[1] * point), across);
        gradients[left][c][1] = slope;
        gradients[right][c][1] = slope;
    }
}

/// Returns the forces of a component from the sums of its stresses along the lower and upper, and the left and right
/// edge.
#[inline(always)]
fn from_edges<V: Value>([low, high]: [V; 2], [left, right]: [V; 2]) -> [V; 4] {
    let weight = low.constant(0.25);
    let near = weight.constant(0.25 * Line::LINEAR.points[0]);
    let far = weight.constant(0.25 * Line::LINEAR.points[1]);
    let (along, across) = ((low + high) * weight, (left + right) * weight);
    let twist = near.madd(low + left, far * (high + right));
    [twist - along - across, along - twist, across - twist, twist]
}

/// Nine nodes and nine points; sums are factorised by direction.
pub struct Biquadratic;

impl Element<9> for Biquadratic {
    const DEGREE: usize = 2;
    const WEIGHTS: [f64; 9] = {
        let w = Line::QUADRATIC.weights;
        let [a, b, c] = w;
        [a * a, b * a, c * a, a * b, b * b, c * b, a * c, b * c, c * c]
    };

    fn masses() -> [[f64; 9]; 9] {
        products(&Line::QUADRATIC)
    }

    fn values() -> [[f64; 9]; 9] {
        values(&Line::QUADRATIC)
    }

    #[inline(always)]
    fn write_gradients<V: Value>(nodal: &[[V; 9]; 2], gradients: &mut [Tensor<V>; 9]) {
        biquadratic_gradients(nodal, [1.0; 2], None, gradients);
    }

    #[inline(always)]
    fn write_gradients_on<V: Value>(
        nodal: &[[V; 9]; 2],
        factors: [f64; 2],
        offset: [f64; 2],
        gradients: &mut [Tensor<V>; 9],
    ) {
        biquadratic_gradients(nodal, factors, Some(offset), gradients);
    }

    #[inline(always)]
    fn forces<V: Value>(stresses: &[Tensor<V>; 9]) -> [[V; 9]; 2] {
        Self::forces_on(stresses, [1.0; 2])
    }

    #[inline(always)]
    fn forces_on<V: Value>(stresses: &[Tensor<V>; 9], [x, y]: [f64; 2]) -> [[V; 9]; 2] {
        let line = &Line::QUADRATIC;
        let zero = stresses[0][0][0].constant(0.0);
        let mut forces = [[zero; 9]; 2];
        for (c, force) in forces.iter_mut().enumerate() {
            for row in 0..3 {
                let [left, middle, right] = [stresses[3 * row][c], stresses[3 * row + 1][c], stresses[3 * row + 2][c]];
                for a in 0..3 {
                    let across = line.weights[row];
                    let along = weighted(
                        [left[0], middle[0], right[0]],
                        transposed(&line.slopes, line.weights, a, across * x),
                    );
                    let rise = weighted(
                        [left[1], middle[1], right[1]],
                        transposed(&line.values, line.weights, a, across * y),
                    );
                    for up in 0..3 {
                        let sum = along.madd(zero.constant(line.values[row][up]), force[3 * up + a]);
                        force[3 * up + a] = rise.madd(zero.constant(line.slopes[row][up]), sum);
                    }
                }
            }
        }
        forces
    }
}

/// Returns the functions at the points, which are products of those of a line.
fn values<const A: usize, const N: usize>(line: &Line<A>) -> [[f64; N]; N] {
    let value = |q: usize, node: usize| line.values[q % A][node % A] * line.values[q / A][node / A];
    std::array::from_fn(|q| std::array::from_fn(|node| value(q, node)))
}

/// Returns the integrals of the products of two functions, which are products of those of a line.
fn products<const A: usize, const N: usize>(line: &Line<A>) -> [[f64; N]; N] {
    let shared: [[f64; A]; A] = std::array::from_fn(|a| {
        std::array::from_fn(|b| {
            let at = |q: usize| line.weights[q] * line.values[q][a] * line.values[q][b];
            (0..A).map(at).sum()
        })
    });
    let mass = |a: usize, b: usize| shared[a % A][b % A] * shared[a / A][b / A];
    std::array::from_fn(|a| std::array::from_fn(|b| mass(a, b)))
}

/// Writes the gradients times two factors, with an offset on the diagonal. The factors are applied to the slopes of the
/// basis; sums start from the offset.
#[inline(always)]
fn biquadratic_gradients<V: Value>(
    nodal: &[[V; 9]; 2],
    [x, y]: [f64; 2],
    offset: Option<[f64; 2]>,
    gradients: &mut [Tensor<V>; 9],
) {
    let line = &Line::QUADRATIC;
    let zero = nodal[0][0].constant(0.0);
    for (c, u) in nodal.iter().enumerate() {
        for row in 0..3 {
            let (mut values, mut rises) = ([zero; 3], [zero; 3]);
            for a in 0..3 {
                let column = [u[a], u[a + 3], u[a + 6]];
                values[a] = weighted(column, line.values[row]);
                rises[a] = weighted(column, scaled(line.slopes[row], y));
            }
            for q in 0..3 {
                let (slopes, at_point) = (scaled(line.slopes[q], x), line.values[q]);
                gradients[3 * row + q][c] = match (c, offset) {
                    (_, None) => [weighted(values, slopes), weighted(rises, at_point)],
                    (0, Some([along, _])) => [weighted_from(along, values, slopes), weighted(rises, at_point)],
                    (_, Some([_, across])) => [weighted(values, slopes), weighted_from(across, rises, at_point)],
                };
            }
        }
    }
}

#[inline(always)]
fn scaled([a, b, c]: [f64; 3], factor: f64) -> [f64; 3] {
    [a * factor, b * factor, c * factor]
}

/// Returns a column of a table times the weights of the points and a factor.
#[inline(always)]
fn transposed(table: &[[f64; 3]; 3], weights: [f64; 3], a: usize, factor: f64) -> [f64; 3] {
    [
        factor * weights[0] * table[0][a],
        factor * weights[1] * table[1][a],
        factor * weights[2] * table[2][a],
    ]
}

#[inline(always)]
fn weighted<V: Value>(terms: [V; 3], factors: [f64; 3]) -> V {
    let [a, b, c] = terms;
    let [f, g, h] = factors;
    a.constant(f).madd(a, b.constant(g).madd(b, c.constant(h) * c))
}

/// Returns the weighted sum added to a number.
#[inline(always)]
fn weighted_from<V: Value>(start: f64, terms: [V; 3], factors: [f64; 3]) -> V {
    let [a, b, c] = terms;
    let [f, g, h] = factors;
    a.constant(f)
        .madd(a, b.constant(g).madd(b, c.constant(h).madd(c, c.constant(start))))
}

/// A Lagrange basis on [0, 1] and its values at the Gauss points.
#[derive(Clone, Copy, Debug)]
pub struct Line<const A: usize> {
    /// Coordinates of the points.
    pub points: [f64; A],
    /// Weights of the points; they add up to 1.
    pub weights: [f64; A],
    /// `values[q][a]`: basis function a at point q.
    pub values: [[f64; A]; A],
    /// `slopes[q][a]`: derivative of basis function a at point q.
    pub slopes: [[f64; A]; A],
}

impl Line<2> {
    /// Linear functions; the points are ½ ∓ 1/√12.
    pub const LINEAR: Self = {
        let (x, y) = (0.211_324_865_405_187_1, 0.788_675_134_594_812_9);
        Self {
            points: [x, y],
            weights: [0.5; 2],
            values: [[1.0 - x, x], [1.0 - y, y]],
            slopes: [[-1.0, 1.0]; 2],
        }
    };
}

impl Line<3> {
    /// Quadratic functions on the nodes 0, ½, 1; the points are ½ and ½ ∓ ½√0.6.
    pub const QUADRATIC: Self = {
        let (x, y) = (0.112_701_665_379_258_3, 0.887_298_334_620_741_7);
        Self {
            points: [x, 0.5, y],
            weights: [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0],
            values: [quadratic_values(x), quadratic_values(0.5), quadratic_values(y)],
            slopes: [quadratic_slopes(x), quadratic_slopes(0.5), quadratic_slopes(y)],
        }
    };
}

const fn quadratic_values(x: f64) -> [f64; 3] {
    [(1.0 - x) * (1.0 - 2.0 * x), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)]
}

const fn quadratic_slopes(x: f64) -> [f64; 3] {
    [4.0 * x - 3.0, 4.0 - 8.0 * x, 4.0 * x - 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::contract;

    fn check_line<const A: usize>(line: &Line<A>) {
        let nodes: [f64; A] = std::array::from_fn(|a| a as f64 / (A - 1) as f64);
        for q in 0..A {
            let x = line.points[q];
            for power in 0..A as i32 {
                let value: f64 = (0..A).map(|a| line.values[q][a] * nodes[a].powi(power)).sum();
                let slope: f64 = (0..A).map(|a| line.slopes[q][a] * nodes[a].powi(power)).sum();
                let exact = if power == 0 {
                    0.0
                } else {
                    f64::from(power) * x.powi(power - 1)
                };
                assert!((value - x.powi(power)).abs() < 1e-15 && (slope - exact).abs() < 1e-14);
            }
        }
        for power in 0..2 * A as i32 {
            let integral: f64 = (0..A).map(|q| line.weights[q] * line.points[q].powi(power)).sum();
            assert!((integral - 1.0 / f64::from(power + 1)).abs() < 1e-15);
        }
    }

    #[test]
    fn bases_reproduce_polynomials_and_rules_integrate_them() {
        check_line(&Line::LINEAR);
        check_line(&Line::QUADRATIC);
    }

    /// Gradients of monomials are exact, and forces are the transpose of gradients.
    fn check_element<E: Element<N>, const N: usize>() {
        let side = E::DEGREE + 1;
        let coordinates = |node: usize| [node % side, node / side].map(|i| i as f64 / E::DEGREE as f64);
        let points: Vec<f64> = if side == 2 {
            Line::LINEAR.points.into()
        } else {
            Line::QUADRATIC.points.into()
        };
        for (i, k) in (0..side as i32).flat_map(|i| (0..side as i32).map(move |k| (i, k))) {
            let values: [f64; N] =
                std::array::from_fn(|node| coordinates(node)[0].powi(i) * coordinates(node)[1].powi(k));
            for (q, gradient) in E::gradients(&[values, values.map(|v| 2.0 * v)]).iter().enumerate() {
                let (x, y) = (points[q % side], points[q / side]);
                let exact = [
                    f64::from(i) * x.powi((i - 1).max(0)) * y.powi(k),
                    f64::from(k) * y.powi((k - 1).max(0)) * x.powi(i),
                ];
                assert!((0..2).all(|d| (gradient[0][d] - exact[d]).abs() < 1e-14));
                assert!((0..2).all(|d| (gradient[1][d] - 2.0 * exact[d]).abs() < 1e-14));
            }
        }
        let wave = |i: usize| (i as f64 * 1.7).sin();
        let nodal: [[f64; N]; 2] = std::array::from_fn(|c| std::array::from_fn(|a| wave(a + 5 * c)));
        let stresses: [Tensor<f64>; N] = std::array::from_fn(|q| [[wave(q), wave(q + 3)], [wave(q + 6), wave(2 * q)]]);
        let forces = E::forces(&stresses);
        let work: f64 = (0..2)
            .flat_map(|c| (0..N).map(move |a| (c, a)))
            .map(|(c, a)| forces[c][a] * nodal[c][a])
            .sum();
        let gradients = E::gradients(&nodal);
        let exact: f64 = (0..N)
            .map(|q| E::WEIGHTS[q] * contract(stresses[q], gradients[q]))
            .sum();
        assert!((work - exact).abs() < 1e-14);
        assert!((E::WEIGHTS.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        // On rectangles both are scaled.
        let (factors, offset) = ([1.7, 0.4], [0.3, -0.2]);
        for (on, plain) in E::gradients_on(&nodal, factors, offset).iter().zip(&gradients) {
            for (i, k) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let expected = plain[i][k] * factors[k] + if i == k { offset[i] } else { 0.0 };
                assert!((on[i][k] - expected).abs() < 1e-14);
            }
        }
        let scaled = stresses.map(|stress| stress.map(|row| [row[0] * factors[0], row[1] * factors[1]]));
        let (on, plain) = (E::forces_on(&stresses, factors), E::forces(&scaled));
        let mut pairs = on.as_flattened().iter().zip(plain.as_flattened());
        assert!(pairs.all(|(a, b)| (a - b).abs() < 1e-14));
    }

    #[test]
    fn gradients_are_exact_and_forces_are_their_transpose() {
        check_element::<Bilinear, 4>();
        check_element::<Biquadratic, 9>();
    }
}
