//! A material that snaps and stiffens, for load paths beyond a snap.

use super::*;
use crate::element::{Bilinear, Element};
use crate::energy::{MODULI, Margins};
use crate::kinematics::{Tensor, add_scaled, cofactor, contract, deformation, determinant, squared_stretches};
use crate::lanes::Real;
use crate::material::Passes;
use crate::operator::MaterialAtRest;

/// A membrane that stiffens after snapping: g′ = −a j⁻³ − S b j + c (j − 1)³. Its passes are plain loops over bilinear
/// squares: kernels of one more material would double the time to compile these tests.
pub struct Stiffening {
    thickness: f64,
    pull: f64,
    stiffness: f64,
}

impl Stiffening {
    pub fn at(share: f64) -> AnyMaterial {
        AnyMaterial::new(Self {
            thickness: 3f64.powi(-6),
            pull: share,
            stiffness: 0.006,
        })
    }

    /// g′ and g″.
    fn slopes(&self, j: f64, active: f64) -> (f64, f64) {
        let rise = j - 1.0;
        let cubic = -self.thickness * j.powi(-3);
        let pull = -self.pull * active;
        let slope = cubic + pull * j + self.stiffness * rise.powi(3);
        (slope, -3.0 * cubic / j + pull + 3.0 * self.stiffness * rise * rise)
    }

    /// Returns f − I at the points of an element, and its activity.
    fn gradients<T: Real>(activity: &Activity, element: [usize; 2], u: &[T]) -> ([Tensor<f64>; 4], f64) {
        let (grid, [column, row]) = (activity.grid(), element);
        let nodes = grid.nodes_of::<4>(element);
        let nodal = [0, u.len() / 2].map(|start| nodes.map(|node| u[start + node].to_f64()));
        let active = activity.elements()[row * grid.layout().part() + column];
        (Bilinear::gradients(&nodal), active)
    }

    /// Writes the forces of stresses that depend on two fields and the activity at each point.
    fn sweep<T: Real>(
        activity: &Activity,
        [u, du]: [&[T]; 2],
        out: &mut [T],
        mut stress: impl FnMut(Tensor<f64>, Tensor<f64>, f64) -> Tensor<f64>,
    ) {
        let (grid, mut sums) = (activity.grid(), vec![0.0; out.len()]);
        for element in grid.each_element() {
            let (at, active) = Self::gradients(activity, element, u);
            let (along, _) = Self::gradients(activity, element, du);
            let stresses = std::array::from_fn(|q| stress(at[q], along[q], active));
            let nodes = grid.nodes_of::<4>(element);
            for (start, forces) in [0, out.len() / 2].into_iter().zip(Bilinear::forces(&stresses)) {
                for (node, force) in nodes.into_iter().zip(forces) {
                    sums[start + node] += force;
                }
            }
        }
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = T::from_f64(sum);
        }
        grid.layout().clear_frame(out);
    }
}

impl<T: Real> Passes<T> for Stiffening {
    fn store_moduli(&self, _: &Activity, _: &[T], moduli: &mut Vec<T>) {
        moduli.clear();
    }

    fn tangent_product(&self, activity: &Activity, step: [&[T]; 2], _: &[T], out: &mut [T]) {
        Self::sweep(activity, step, out, |gradient, df, active| {
            self.tangent(gradient, active, df)
        });
    }

    fn smallest_margins(&self, activity: &Activity, u: &[T]) -> Margins<f64> {
        let elements = activity.grid().each_element();
        let points = elements.flat_map(|element| {
            let (gradients, active) = Self::gradients(activity, element, u);
            gradients.map(|gradient| self.margins(deformation(gradient), active).ellipticity)
        });
        Margins {
            ellipticity: points.fold(f64::INFINITY, f64::min),
            convexity: -1.0,
            tension: f64::INFINITY,
        }
    }

    fn at_rest(&self) -> MaterialAtRest {
        unreachable!("it stores no moduli")
    }
}

impl Material for Stiffening {
    fn wrinkles(&self) -> bool {
        false
    }

    fn has_several_branches(&self) -> bool {
        true
    }

    fn stores_moduli(&self) -> bool {
        false
    }

    fn load(&self) -> f64 {
        self.pull
    }

    fn largest_load(&self) -> f64 {
        2.0
    }

    fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64> {
        Material::self_stress(&NeoHookean::of(self.thickness, self.pull), f)
    }

    fn energy(&self, f: Tensor<f64>, active: f64) -> f64 {
        let j = determinant(f);
        let of_area = self.thickness * j.powi(-2) - self.pull * active * j * j;
        0.5 * (contract(f, f) + of_area) + 0.25 * self.stiffness * (j - 1.0).powi(4)
    }

    fn stress(&self, gradient: Tensor<f64>, active: f64) -> Tensor<f64> {
        let f = deformation(gradient);
        let (slope, _) = self.slopes(determinant(f), active);
        add_scaled(gradient, slope + self.thickness, cofactor(f))
    }

    fn tangent(&self, gradient: Tensor<f64>, active: f64, df: Tensor<f64>) -> Tensor<f64> {
        let f = deformation(gradient);
        let (slope, curvature) = self.slopes(determinant(f), active);
        let c = cofactor(f);
        add_scaled(add_scaled(df, curvature * contract(c, df), c), slope, cofactor(df))
    }

    fn moduli(&self, gradient: Tensor<f64>, active: f64) -> [f64; MODULI] {
        let (slope, curvature) = self.slopes(determinant(deformation(gradient)), active);
        [1.0, slope, 0.0, 0.0, curvature]
    }

    fn admissible(&self, gradient: Tensor<f64>) -> f64 {
        determinant(deformation(gradient))
    }

    fn margins(&self, f: Tensor<f64>, active: f64) -> Margins<f64> {
        let (_, curvature) = self.slopes(determinant(f), active);
        let [largest, _] = squared_stretches(f);
        Margins {
            ellipticity: 1.0 + curvature.min(0.0) * largest,
            convexity: -1.0,
            tension: 1.0,
        }
    }

    fn with_unrelaxed(&self, _: f64) -> Option<Self> {
        None
    }

    fn any_with_unrelaxed(&self, _: f64) -> Option<AnyMaterial> {
        None
    }

    fn energies(&self, _: [&[f64]; 4], _: &[f64], _: bool, _: &mut [f64]) {
        unreachable!("it does not move in time")
    }

    fn forces(&self, activity: &Activity, u: &[f64], out: &mut [f64]) -> f64 {
        let mut smallest = f64::INFINITY;
        Self::sweep(activity, [u; 2], out, |gradient, _, active| {
            smallest = smallest.min(self.admissible(gradient));
            self.stress(gradient, active)
        });
        smallest
    }

    fn forces_between(&self, _: &Activity, _: [&[f64]; 2], _: &mut [f64]) {
        unreachable!("it does not move in time")
    }
}
