//! A membrane as a surface in space: forces and tangent on a mesh, and the volume below it.
//!
//! Vectors have three planes: both components in the plane, then that out of it. The volume between the membrane and
//! its plane is ∫ w det f dX; where the edge is held its gradient b is the force of a unit pressure that follows the
//! surface.

use deaflow_field::Order;
use deaflow_pattern::Part;

use super::flat::OutOfPlane;
use super::point::{PointState, Spatial, apply, root, second_stress};
use crate::element::{Bilinear, Biquadratic, Element};
use crate::grid::Grid;
use crate::kinematics::{Tensor, cofactor, contract, determinant};
use crate::material::Material;
use crate::operator::Activity;

/// A membrane that can leave its plane.
pub(super) struct Surface<'a, L> {
    pub material: &'a L,
    pub activity: &'a Activity,
    pub heights: &'a OutOfPlane,
}

/// Energy and volume of a state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Totals {
    pub energy: f64,
    pub volume: f64,
}

/// Stress, moduli and heights at all points of a state.
pub(super) struct Linearised {
    points: Vec<(PointState, f64)>,
}

/// Nodal values of an element, or forces on its nodes.
type Nodal<const N: usize> = [[f64; N]; 3];

impl<L: Material> Surface<'_, L> {
    fn grid(&self) -> &Grid {
        self.activity.grid()
    }

    /// Returns the length of vectors.
    pub fn len(&self) -> usize {
        3 * self.plane()
    }

    fn plane(&self) -> usize {
        self.grid().layout().vector_len() / 2
    }

    /// Sets what does not move to zero.
    pub fn restrict(&self, vector: &mut [f64]) {
        let (planar, height) = vector.split_at_mut(2 * self.plane());
        // There are no bodies.
        self.grid().restrict_at(&[], planar);
        self.heights.restrict(height);
    }

    /// Writes the forces of the elements, and of a unit pressure with the opposite sign, into two vectors; returns
    /// energy and volume. `None` where the law is not defined.
    pub fn evaluate(&self, x: &[f64], forces: &mut [f64], pressed: &mut [f64]) -> Option<Totals> {
        let totals = match self.grid().order() {
            Order::Bilinear => self.evaluate_by::<Bilinear, 4>(x, forces, pressed),
            Order::Biquadratic => self.evaluate_by::<Biquadratic, 9>(x, forces, pressed),
        };
        self.restrict(forces);
        self.restrict(pressed);
        totals
    }

    fn evaluate_by<E: Element<N>, const N: usize>(
        &self,
        x: &[f64],
        forces: &mut [f64],
        pressed: &mut [f64],
    ) -> Option<Totals> {
        forces.fill(0.0);
        pressed.fill(0.0);
        let mut totals = Totals {
            energy: 0.0,
            volume: 0.0,
        };
        for element in membrane(self.grid()) {
            let nodes = self.grid().nodes_of::<N>(element);
            let nodal = self.nodal(x, &nodes);
            let (gradients, heights) = self.at_points::<E, N>(element, &nodal);
            let areas = self.grid().areas_of(element, E::WEIGHTS);
            let mut stress = [[[0.0; 2]; 3]; N];
            for q in 0..N {
                let active = self.activity.at_point(element[1], q, N)[element[0]];
                let u = root(self.material, &gradients[q])?;
                totals.energy += areas[q] * self.material.energy(u, active);
                let second = second_stress(self.material, u, active);
                stress[q] = gradients[q].map(|row| apply(second, row));
            }
            self.add_to(forces, &nodes, &self.forces_of::<E, N>(element, &stress));
            let volumes = self.pressed::<E, N>(element, &areas, &gradients, &heights);
            totals.volume += volumes.0;
            self.add_to(pressed, &nodes, &volumes.1);
        }
        Some(totals)
    }

    /// Prepares tangents at a state; `None` where the law is not defined.
    pub fn linearise(&self, x: &[f64]) -> Option<Linearised> {
        match self.grid().order() {
            Order::Bilinear => self.linearise_by::<Bilinear, 4>(x),
            Order::Biquadratic => self.linearise_by::<Biquadratic, 9>(x),
        }
    }

    fn linearise_by<E: Element<N>, const N: usize>(&self, x: &[f64]) -> Option<Linearised> {
        let mut points = Vec::new();
        for element in membrane(self.grid()) {
            let nodal = self.nodal(x, &self.grid().nodes_of::<N>(element));
            let (gradients, heights) = self.at_points::<E, N>(element, &nodal);
            for q in 0..N {
                let active = self.activity.at_point(element[1], q, N)[element[0]];
                points.push((PointState::new(self.material, gradients[q], active)?, heights[q]));
            }
        }
        Some(Linearised { points })
    }

    /// Writes the change of the forces at a pressure, which follows the surface, into `out`.
    pub fn tangent(&self, at: &Linearised, pressure: f64, change: &[f64], out: &mut [f64]) {
        match self.grid().order() {
            Order::Bilinear => self.tangent_by::<Bilinear, 4>(at, pressure, change, out),
            Order::Biquadratic => self.tangent_by::<Biquadratic, 9>(at, pressure, change, out),
        }
        self.restrict(out);
    }

    fn tangent_by<E: Element<N>, const N: usize>(
        &self,
        at: &Linearised,
        pressure: f64,
        change: &[f64],
        out: &mut [f64],
    ) {
        out.fill(0.0);
        for (element, points) in membrane(self.grid()).zip(at.points.chunks_exact(N)) {
            let nodes = self.grid().nodes_of::<N>(element);
            let nodal = self.nodal(change, &nodes);
            let (changes, heights) = self.changes_at::<E, N>(element, &nodal);
            let mut stress: [Spatial; N] = std::array::from_fn(|q| points[q].0.tangent(&changes[q]));
            let mut loads = [0.0; N];
            if pressure != 0.0 {
                let areas = self.grid().areas_of(element, E::WEIGHTS);
                for q in 0..N {
                    let (state, height) = &points[q];
                    let (f, df) = (in_plane(&state.f), in_plane(&changes[q]));
                    let (cof, dcof) = (cofactor(f), cofactor(df));
                    for i in 0..2 {
                        for k in 0..2 {
                            stress[q][i][k] -= pressure * (heights[q] * cof[i][k] + height * dcof[i][k]);
                        }
                    }
                    loads[q] = -pressure * areas[q] * contract(cof, df);
                }
            }
            let mut forces = self.forces_of::<E, N>(element, &stress);
            if pressure != 0.0 {
                let values = self.grid().values_of::<E, N>(element);
                for (q, load) in loads.into_iter().enumerate() {
                    forces[2]
                        .iter_mut()
                        .zip(values[q])
                        .for_each(|(force, value)| *force += load * value);
                }
            }
            self.add_to(out, &nodes, &forces);
        }
    }

    fn nodal<const N: usize>(&self, x: &[f64], nodes: &[usize; N]) -> Nodal<N> {
        let plane = self.plane();
        [0, 1, 2].map(|c| nodes.map(|at| x[at + c * plane]))
    }

    fn add_to<const N: usize>(&self, out: &mut [f64], nodes: &[usize; N], forces: &Nodal<N>) {
        let plane = self.plane();
        for (c, forces) in forces.iter().enumerate() {
            nodes
                .iter()
                .zip(forces)
                .for_each(|(at, force)| out[at + c * plane] += force);
        }
    }

    /// Returns the deformation gradients and the heights at the points of an element.
    fn at_points<E: Element<N>, const N: usize>(
        &self,
        element: [usize; 2],
        nodal: &Nodal<N>,
    ) -> ([Spatial; N], [f64; N]) {
        let (mut changes, heights) = self.changes_at::<E, N>(element, nodal);
        let rest = self.grid().rest();
        for change in &mut changes {
            change[0][0] += rest[0];
            change[1][1] += rest[1];
        }
        (changes, heights)
    }

    fn changes_at<E: Element<N>, const N: usize>(
        &self,
        element: [usize; 2],
        nodal: &Nodal<N>,
    ) -> ([Spatial; N], [f64; N]) {
        let planar = self.grid().changes::<E, N>(element, &[nodal[0], nodal[1]]);
        let slopes = self.grid().changes::<E, N>(element, &[nodal[2], [0.0; N]]);
        let values = self.grid().values_of::<E, N>(element);
        let height = |q: usize| values[q].iter().zip(&nodal[2]).map(|(value, w)| value * w).sum();
        (
            std::array::from_fn(|q| [planar[q][0], planar[q][1], slopes[q][0]]),
            std::array::from_fn(height),
        )
    }

    fn forces_of<E: Element<N>, const N: usize>(&self, element: [usize; 2], stress: &[Spatial; N]) -> Nodal<N> {
        let planar = self
            .grid()
            .forces::<E, N>(element, std::array::from_fn(|q| [stress[q][0], stress[q][1]]));
        let across = self
            .grid()
            .forces::<E, N>(element, std::array::from_fn(|q| [stress[q][2], [0.0; 2]]));
        [planar[0], planar[1], across[0]]
    }

    /// Returns the volume below an element and its gradient.
    fn pressed<E: Element<N>, const N: usize>(
        &self,
        element: [usize; 2],
        areas: &[f64; N],
        gradients: &[Spatial; N],
        heights: &[f64; N],
    ) -> (f64, Nodal<N>) {
        let values = self.grid().values_of::<E, N>(element);
        let planes = gradients.map(|gradient| in_plane(&gradient));
        let weighted: [f64; N] = std::array::from_fn(|q| areas[q] * determinant(planes[q]));
        let volume = (0..N).map(|q| weighted[q] * heights[q]).sum();
        let stresses = std::array::from_fn(|q| cofactor(planes[q]).map(|row| row.map(|value| heights[q] * value)));
        let [x, y] = self.grid().forces::<E, N>(element, stresses);
        let up = std::array::from_fn(|node| (0..N).map(|q| weighted[q] * values[q][node]).sum());
        (volume, [x, y, up])
    }
}

fn in_plane(f: &Spatial) -> Tensor<f64> {
    [f[0], f[1]]
}

/// Returns the elements that are membrane.
fn membrane(grid: &Grid) -> impl Iterator<Item = [usize; 2]> + '_ {
    let is_membrane = |element: &[usize; 2]| grid.content(*element).part == Part::Membrane;
    grid.each_element().filter(is_membrane)
}

impl Linearised {
    /// Returns the share of the points whose smaller principal stress is a compression, of more than a share of the
    /// larger one. F S Fᵀ has the signs of S.
    pub fn compressed(&self, rounding: f64) -> f64 {
        let is_compressed = |state: &PointState| {
            let [[first, across], [_, second]] = state.stress;
            let mean = 0.5 * (first + second);
            let radius = (0.5 * (first - second)).hypot(across);
            mean - radius < -rounding * (mean.abs() + radius)
        };
        let compressed = self.points.iter().filter(|(state, _)| is_compressed(state)).count();
        compressed as f64 / self.points.len().max(1) as f64
    }
}
