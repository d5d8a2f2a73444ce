//! A membrane as a surface in space: forces and tangent on a mesh, and the volume below it.
//!
//! Vectors have three planes: both components in the plane, then that out of it. The volume between the membrane and
//! its plane is ∫ w det f dX; where the edge is held its gradient b is the force of a unit pressure that follows the
//! surface. Bodies move as in the plane, and have one height: their elements have no energy, and the volume below them
//! is their area times the height.

use deaflow_field::Order;
use deaflow_pattern::Part;

use super::flat::OutOfPlane;
use super::lifted::Lifted;
use super::point::{PointState, Spatial, apply, root, second_stress};
use crate::element::{Bilinear, Biquadratic, Element};
use crate::grid::Grid;
use crate::kinematics::{Tensor, add_scaled, cofactor, contract, determinant};
use crate::material::Material;
use crate::operator::Activity;
use crate::rigid::Pose;
use crate::supports::Supports;

/// A membrane that can leave its plane.
pub(crate) struct Surface<'a, L> {
    pub material: &'a L,
    pub activity: &'a Activity,
    pub heights: &'a OutOfPlane,
    pub bodies: &'a [Lifted],
    /// Share of the forces out of the plane on bodies.
    pub share: f64,
}

/// Energy and volume of a state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Totals {
    pub energy: f64,
    pub volume: f64,
    /// The size of the forces in the plane, and out of it, before those of neighbours cancel: their rounding is in
    /// proportion, and so is that of the energy to the square of the first.
    pub uncancelled: [f64; 2],
}

/// Stress, moduli and heights at all points of a state, and the poses of bodies.
pub(crate) struct Linearised {
    points: Vec<(PointState, f64)>,
    pub poses: Vec<Pose>,
    /// Curvatures of the rotations of bodies: by the forces of the elements, and by those of a unit pressure with the
    /// opposite sign.
    curvatures: [Vec<f64>; 2],
}

/// Sums over the membrane in a cell.
#[derive(Clone, Copy, Debug, Default)]
struct CellSums {
    area: f64,
    /// F times area.
    deformation: Spatial,
    /// Activity of the strongest electrode.
    strongest: f64,
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

    /// Returns the poses of bodies in the plane.
    pub fn poses(&self, x: &[f64]) -> Vec<Pose> {
        self.grid().poses(&x[..2 * self.plane()])
    }

    /// Returns a state in which the motion of every body is rigid, after a step along the tangent.
    pub fn settled(&self, mut x: Vec<f64>) -> Vec<f64> {
        self.grid().settle(&mut x[..2 * self.plane()]);
        x
    }

    /// Returns the forces out of the plane on bodies.
    pub fn lifts(&self) -> Vec<f64> {
        let mut lifts = vec![0.0; self.len()];
        for body in self.bodies {
            body.spread(self.share * body.lift().load, &mut lifts[2 * self.plane()..]);
        }
        lifts
    }

    /// Projects a vector onto the admissible changes: zero where nothing moves, rigid on bodies.
    pub fn restrict(&self, poses: &[Pose], vector: &mut [f64]) {
        let (planar, height) = vector.split_at_mut(2 * self.plane());
        self.grid().restrict_at(poses, planar);
        self.restrict_heights(height, |_| 0.0);
    }

    /// Like [`Self::restrict`] for heights, with more forces on bodies.
    fn restrict_heights(&self, height: &mut [f64], more: impl Fn(&Lifted) -> f64) {
        let forces: Vec<f64> = self.bodies.iter().map(|body| body.force(height) + more(body)).collect();
        self.heights.restrict(height);
        for (body, force) in self.bodies.iter().zip(forces) {
            body.spread(force, height);
        }
    }

    /// Writes the forces of the elements, and of a unit pressure with the opposite sign, into two vectors; returns
    /// energy and volume. `None` where the law is not defined.
    pub fn evaluate(&self, x: &[f64], forces: &mut [f64], pressed: &mut [f64]) -> Option<Totals> {
        let totals = match self.grid().order() {
            Order::Bilinear => self.evaluate_by::<Bilinear, 4>(x, forces, pressed),
            Order::Biquadratic => self.evaluate_by::<Biquadratic, 9>(x, forces, pressed),
        };
        let mut totals = totals?;
        let (plane, poses) = (self.plane(), self.poses(x));
        for body in self.bodies {
            let height = body.height(&x[2 * plane..]);
            totals.energy += body.energy(height, self.share);
            totals.volume += body.volume(height);
        }
        self.restrict_heights(&mut pressed[2 * plane..], Lifted::area);
        self.grid().restrict_at(&poses, &mut pressed[..2 * plane]);
        let (planar, height) = forces.split_at_mut(2 * plane);
        self.restrict_heights(height, |body| {
            let lift = body.lift();
            lift.spring * body.height(&x[2 * plane..]) - self.share * lift.load
        });
        self.grid().layout().clear_frame(planar);
        if let Some(supports) = self.grid().supports() {
            totals.energy += supports.energy(&poses);
            supports.restrict_forces(&poses, 1.0, planar);
        }
        Some(totals)
    }

    fn evaluate_by<E: Element<N>, const N: usize>(
        &self,
        x: &[f64],
        forces: &mut [f64],
        pressed: &mut [f64],
    ) -> Option<Totals> {
        forces.fill(0.0);
        pressed.fill(0.0);
        let mut totals = Totals::default();
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
                let [x, y] = gradients[q][2];
                // Stress is the difference of parts of the size of the shear modulus, which is 1.
                let square = areas[q] * (1.0 + contract(second, second));
                totals.uncancelled[0] += square;
                totals.uncancelled[1] += square * (x * x + y * y);
            }
            self.add_to(forces, &nodes, &self.forces_of::<E, N>(element, &stress));
            let volumes = self.pressed::<E, N>(element, &areas, &gradients, &heights);
            totals.volume += volumes.0;
            self.add_to(pressed, &nodes, &volumes.1);
        }
        totals.uncancelled = totals.uncancelled.map(f64::sqrt);
        Some(totals)
    }

    /// Returns the area stretch of the mean deformation gradient of each cell with membrane, and the activity of its
    /// strongest electrode.
    pub fn stretched_cells(&self, x: &[f64]) -> Vec<[f64; 2]> {
        let cells = match self.grid().order() {
            Order::Bilinear => self.cells_by::<Bilinear, 4>(x),
            Order::Biquadratic => self.cells_by::<Biquadratic, 9>(x),
        };
        let of_cell = |cell: &CellSums| {
            let product = |a: usize, b: usize| -> f64 { cell.deformation.iter().map(|row| row[a] * row[b]).sum() };
            let square = product(0, 0) * product(1, 1) - product(0, 1).powi(2);
            [square.max(0.0).sqrt() / cell.area.powi(2), cell.strongest]
        };
        cells.iter().filter(|cell| cell.area > 0.0).map(of_cell).collect()
    }

    fn cells_by<E: Element<N>, const N: usize>(&self, x: &[f64]) -> Vec<CellSums> {
        let (grid, columns) = (self.grid(), self.grid().raster().columns());
        let mut cells = vec![CellSums::default(); grid.raster().cells()];
        for element in membrane(grid) {
            let nodal = self.nodal(x, &grid.nodes_of::<N>(element));
            let (gradients, _) = self.at_points::<E, N>(element, &nodal);
            let [column, row] = grid.cell_of(element);
            let cell = &mut cells[row * columns + column];
            for (gradient, area) in gradients.iter().zip(grid.areas_of(element, E::WEIGHTS)) {
                cell.area += area;
                for (sum, row) in cell.deformation.iter_mut().zip(gradient) {
                    *sum = [sum[0] + area * row[0], sum[1] + area * row[1]];
                }
            }
            cell.strongest = cell.strongest.max(self.activity.strongest(element[1])[element[0]]);
        }
        cells
    }

    /// Returns −ψ · ∂F/∂S of each cell, `[y][x]`, for the forces F and the activities S, in which the energy is linear.
    pub fn of_cells(&self, x: &[f64], adjoint: &[f64]) -> Option<Vec<f64>> {
        match self.grid().order() {
            Order::Bilinear => self.of_cells_by::<Bilinear, 4>(x, adjoint),
            Order::Biquadratic => self.of_cells_by::<Biquadratic, 9>(x, adjoint),
        }
    }

    fn of_cells_by<E: Element<N>, const N: usize>(&self, x: &[f64], adjoint: &[f64]) -> Option<Vec<f64>> {
        let raster = self.grid().raster();
        let mut cells = vec![0.0; raster.cells()];
        for element in membrane(self.grid()) {
            let nodes = self.grid().nodes_of::<N>(element);
            let (gradients, _) = self.at_points::<E, N>(element, &self.nodal(x, &nodes));
            let mut stress = [[[0.0; 2]; 3]; N];
            for q in 0..N {
                let u = root(self.material, &gradients[q])?;
                let [active, bare] = [1.0, 0.0].map(|active| second_stress(self.material, u, active));
                stress[q] = gradients[q].map(|row| apply(add_scaled(active, -1.0, bare), row));
            }
            let forces = self.forces_of::<E, N>(element, &stress);
            let adjoint = self.nodal(adjoint, &nodes);
            let pairs = forces.as_flattened().iter().zip(adjoint.as_flattened());
            let [column, row] = self.grid().cell_of(element);
            cells[row * raster.columns() + column] -= pairs.map(|(force, psi)| force * psi).sum::<f64>();
        }
        Some(cells)
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
        let [mut forces, mut pressed] =
            [(); 2].map(|()| vec![0.0; if self.bodies.is_empty() { 0 } else { self.len() }]);
        for element in membrane(self.grid()) {
            let nodes = self.grid().nodes_of::<N>(element);
            let nodal = self.nodal(x, &nodes);
            let (gradients, heights) = self.at_points::<E, N>(element, &nodal);
            let mut stress = [[[0.0; 2]; 3]; N];
            for q in 0..N {
                let active = self.activity.at_point(element[1], q, N)[element[0]];
                let state = PointState::new(self.material, gradients[q], active)?;
                stress[q] = state.f.map(|row| apply(state.stress, row));
                points.push((state, heights[q]));
            }
            if !self.bodies.is_empty() {
                self.add_to(&mut forces, &nodes, &self.forces_of::<E, N>(element, &stress));
                let areas = self.grid().areas_of(element, E::WEIGHTS);
                let (_, volumes) = self.pressed::<E, N>(element, &areas, &gradients, &heights);
                self.add_to(&mut pressed, &nodes, &volumes);
            }
        }
        let poses = self.poses(x);
        let of_bodies = |supports: &Supports| {
            [
                supports.curvatures(&poses, 1.0, &forces),
                supports.curvatures(&poses, 0.0, &pressed),
            ]
        };
        let supports = self.grid().supports().filter(|_| !self.bodies.is_empty());
        Some(Linearised {
            curvatures: supports.map(of_bodies).unwrap_or_default(),
            points,
            poses,
        })
    }

    /// Writes the change of the forces at a pressure, which follows the surface, into `out`.
    pub fn tangent(&self, at: &Linearised, pressure: f64, change: &[f64], out: &mut [f64]) {
        match self.grid().order() {
            Order::Bilinear => self.tangent_by::<Bilinear, 4>(at, pressure, change, out),
            Order::Biquadratic => self.tangent_by::<Biquadratic, 9>(at, pressure, change, out),
        }
        let plane = self.plane();
        let (planar, height) = out.split_at_mut(2 * plane);
        self.restrict_heights(height, |body| body.lift().spring * body.height(&change[2 * plane..]));
        self.grid().layout().clear_frame(planar);
        if let Some(supports) = self.grid().supports() {
            let [forces, pressed] = &at.curvatures;
            let curvatures: Vec<f64> = forces
                .iter()
                .zip(pressed)
                .map(|(own, by)| own - pressure * by)
                .collect();
            supports.restrict_product(&at.poses, &curvatures, &change[..2 * plane], planar);
        }
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

#[cfg(test)]
mod tests {
    use super::super::lifted::bodies;
    use super::*;
    use crate::eigenvalue::dot;
    use crate::energy::NeoHookean;
    use crate::material::AnyMaterial;
    use crate::sheet::{Sheet, lifts};
    use deaflow_field::Mesh;
    use deaflow_pattern::Pattern;
    use deaflow_scene::Scene;

    /// Waves in all components, with bodies that have moved and turned.
    fn waves(surface: &Surface<'_, AnyMaterial>, size: f64, phase: f64) -> Vec<f64> {
        let mut x: Vec<f64> = (0..surface.len())
            .map(|i| size * (i as f64 * 0.61 + phase).sin())
            .collect();
        surface.restrict(&surface.poses(&vec![0.0; x.len()]), &mut x);
        let plane = surface.plane();
        for body in surface.grid().supports().unwrap().bodies() {
            let moved = [0.7 * phase.sin(), -0.4, 0.2 * phase.cos()];
            body.nodes.write(&Pose::REST, moved, &mut x[..2 * plane]);
        }
        for body in surface.bodies {
            body.spread(3.0 * phase.cos(), &mut x[2 * plane..]);
        }
        surface.settled(x)
    }

    #[test]
    fn forces_and_tangents_of_bodies_are_differences_of_the_potential() {
        let scene = Scene::from_text(
            "{ geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10, bodies: [{ rectangle: [[10 mm, \
             10 mm], [20 mm, 25 mm]], load: [0.1 N, -0.2 N, 0.3 N], spring: [20 N/m, 50 N/m, 30 N/m] }] }, material: { \
             model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }, drive: { voltage: 4 kV } }",
        )
        .unwrap();
        for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
            let grid = Grid::uniform(mesh, &Sheet::of(&scene));
            let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| x + y > 8);
            let activity = Activity::new(&grid, &pattern);
            let (heights, of_grid) = (
                OutOfPlane::new(&grid).unwrap(),
                bodies(&grid, &lifts(&scene, grid.unit_mm())),
            );
            assert!((of_grid[0].area() - 6.0 * grid.elements()[0].pow(2) as f64 / 100.0).abs() < 1e-9);
            let surface = Surface {
                material: &AnyMaterial::from(NeoHookean::new(3.0, scene.kappa())),
                activity: &activity,
                heights: &heights,
                bodies: &of_grid,
                share: 0.8,
            };
            let (x, pressure) = (waves(&surface, 0.02, 0.4), 0.01);
            let (mut forces, mut pressed) = (vec![0.0; x.len()], vec![0.0; x.len()]);
            let mut potential = |x: &[f64]| {
                let totals = surface.evaluate(x, &mut forces, &mut pressed).unwrap();
                let residual: Vec<f64> = forces.iter().zip(&pressed).map(|(f, b)| f - pressure * b).collect();
                (totals.energy - pressure * totals.volume, residual)
            };
            let at = surface.linearise(&x).unwrap();
            let mut change = waves(&surface, 0.3, 1.9);
            surface.restrict(&at.poses, &mut change);
            let moved = |step: f64| surface.settled(x.iter().zip(&change).map(|(x, dx)| x + step * dx).collect());
            let step = 1e-3;
            let [(before, _), (here, residual), (after, _)] = [-step, 0.0, step].map(|step| potential(&moved(step)));
            let slope = dot(&residual, &change);
            assert!(
                ((after - before) / (2.0 * step) - slope).abs() < 1e-5 * slope.abs(),
                "{slope}"
            );
            let mut image = vec![0.0; x.len()];
            surface.tangent(&at, pressure, &change, &mut image);
            let (curvature, found) = (dot(&image, &change), (after - 2.0 * here + before) / step.powi(2));
            assert!(
                (found - curvature).abs() < 1e-4 * curvature.abs(),
                "{found} {curvature}"
            );
            // Symmetric.
            let mut other = waves(&surface, 0.2, 2.7);
            surface.restrict(&at.poses, &mut other);
            let across = dot(&image, &other);
            surface.tangent(&at, pressure, &other, &mut image);
            assert!((dot(&image, &change) - across).abs() < 1e-10 * curvature);
        }
    }
}
