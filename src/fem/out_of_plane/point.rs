//! The law of a point of a surface in space.
//!
//! The energy depends on C = FᵀF alone, so that it is that of any deformation U in the plane with UᵀU = C: laws in the
//! plane give stress and tangent of surfaces.
//!
//! ```text
//! S = U⁻¹ p(U)                second Piola-Kirchhoff stress, with the part without forces in the plane
//! δU = Y U,  Y + Yᵀ = U⁻ᵀ δC U⁻¹,  Y upper triangular as U
//! δS = U⁻¹ (δp − δU S)
//! P = F S,  δP = δF S + F δS
//! ```

use crate::kinematics::{Tensor, add_scaled, cofactor, determinant, times_transposed, transposed};
use crate::material::Material;

/// A deformation gradient of a surface in space, `[component][direction]`.
pub(super) type Spatial = [[f64; 2]; 3];

const ONE: Tensor<f64> = [[1.0, 0.0], [0.0, 1.0]];

/// Stress and moduli at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PointState {
    pub f: Spatial,
    pub stress: Tensor<f64>,
    /// ∂S/∂C, by the entries of S and C.
    pub moduli: [[f64; 3]; 3],
}

/// Returns the upper triangular U with UᵀU = C; `None` where the law is not defined.
pub(super) fn root<L: Material>(material: &L, f: &Spatial) -> Option<Tensor<f64>> {
    let product = |a: usize, b: usize| -> f64 { f.iter().map(|row| row[a] * row[b]).sum() };
    let (first, across, second) = (product(0, 0), product(0, 1), product(1, 1));
    let along = first.sqrt();
    let shear = across / along;
    let square = second - shear * shear;
    let u = (first > 0.0 && square > 0.0).then(|| [[along, shear], [0.0, square.sqrt()]])?;
    (material.admissible(add_scaled(u, -1.0, ONE)) > 0.0).then_some(u)
}

/// Returns S at a deformation in the plane, with the stress that has no forces in the plane.
pub(super) fn second_stress<L: Material>(material: &L, f: Tensor<f64>, active: f64) -> Tensor<f64> {
    let stress = add_scaled(
        material.stress(add_scaled(f, -1.0, ONE), active),
        1.0,
        material.self_stress(f),
    );
    let second = product(inverse(f), stress);
    let shear = 0.5 * (second[0][1] + second[1][0]);
    [[second[0][0], shear], [shear, second[1][1]]]
}

impl PointState {
    /// Returns stress and moduli; `None` where the law is not defined.
    pub fn new<L: Material>(material: &L, f: Spatial, active: f64) -> Option<Self> {
        let u = root(material, &f)?;
        let gradient = add_scaled(u, -1.0, ONE);
        let stress = second_stress(material, u, active);
        let back = inverse(u);
        let uniform = material.self_stress([[0.0; 2]; 2]);
        let column = |entry: usize| {
            let change: Tensor<f64> = match entry {
                0 => [[1.0, 0.0], [0.0, 0.0]],
                1 => [[0.0, 1.0], [1.0, 0.0]],
                _ => [[0.0, 0.0], [0.0, 1.0]],
            };
            let both = product(times_transposed(transposed(back), transposed(change)), back);
            let turned = [[0.5 * both[0][0], both[0][1]], [0.0, 0.5 * both[1][1]]];
            let du = product(turned, u);
            // It is an affine function.
            let of_self = add_scaled(material.self_stress(du), -1.0, uniform);
            let dp = add_scaled(material.tangent(gradient, active, du), 1.0, of_self);
            let ds = product(back, add_scaled(dp, -1.0, product(du, stress)));
            [ds[0][0], 0.5 * (ds[0][1] + ds[1][0]), ds[1][1]]
        };
        let columns = [0, 1, 2].map(column);
        Some(Self {
            f,
            stress,
            moduli: std::array::from_fn(|row| std::array::from_fn(|entry| columns[entry][row])),
        })
    }

    /// Returns δP for a change of F.
    pub fn tangent(&self, change: &Spatial) -> Spatial {
        let twice = |a: usize, b: usize| -> f64 {
            self.f
                .iter()
                .zip(change)
                .map(|(f, df)| f[a] * df[b] + df[a] * f[b])
                .sum()
        };
        let metric = [twice(0, 0), twice(0, 1), twice(1, 1)];
        let [first, across, second] = self
            .moduli
            .map(|row| row[0] * metric[0] + row[1] * metric[1] + row[2] * metric[2]);
        let stress = [[first, across], [across, second]];
        std::array::from_fn(|row| {
            let (a, b) = (apply(self.stress, change[row]), apply(stress, self.f[row]));
            [a[0] + b[0], a[1] + b[1]]
        })
    }
}

/// Returns the product of a tensor and a vector.
pub(super) fn apply(tensor: Tensor<f64>, [x, y]: [f64; 2]) -> [f64; 2] {
    tensor.map(|[a, b]| a * x + b * y)
}

fn product(a: Tensor<f64>, b: Tensor<f64>) -> Tensor<f64> {
    times_transposed(a, transposed(b))
}

fn inverse(f: Tensor<f64>) -> Tensor<f64> {
    let size = determinant(f);
    transposed(cofactor(f)).map(|row| row.map(|value| value / size))
}
