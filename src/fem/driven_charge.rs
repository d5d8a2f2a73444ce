//! The charge on the electrodes at the voltage of a scene, and its derivatives.
//!
//! With the electric energy −e(u, S) of the membrane at the voltage V, the charge is Q = 2e/V. For an ideal dielectric
//! it is V times the capacitance, C = ∫ S ε λp² g²/H dX. Of groups with lower voltages, it is that which the strongest
//! one would need for the same energy. Q is linear in the activity S, so dQ/dS is the charge of a fully active cell,
//! and what follows from the motion: the adjoint of ∂Q/∂u, which are the electric forces times 2/V.

use deaflow_field::Order;
use deaflow_pattern::{Part, Pattern};

use super::effects::WithMaterial;
use super::element::{Bilinear, Biquadratic, Element};
use super::kinematics::deformation;
use super::material::Material;
use super::operator::{Activity, Operator, metrics};
use super::solver::MembraneSolver;
use super::stored::{Units, content, weights};

/// From C to nC.
const NANO: f64 = 1e9;

impl MembraneSolver {
    /// The charge in nC of a unit of electric energy.
    pub(super) fn charge_unit(&self) -> f64 {
        let voltage = self.scene.voltage_v();
        let energy = Units::new(&self.scene, self.grid.unit_mm()).energy;
        if voltage > 0.0 {
            2.0 * NANO * energy / voltage
        } else {
            0.0
        }
    }

    /// The charge in nC on the electrodes of a pattern at a displacement.
    pub(super) fn driven_charge(&self, pattern: &Pattern, u: &[f64]) -> f64 {
        let activity = self.model.activity(&self.grid, pattern);
        self.model.with(DrivenCharge {
            solver: self,
            activity: &activity,
            u,
        })
    }
}

/// Computes the charge in nC.
struct DrivenCharge<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    u: &'a [f64],
}

impl WithMaterial for DrivenCharge<'_> {
    type Output = f64;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> f64 {
        let (solver, laws) = (self.solver, [material(0.0), material(1.0)]);
        let units = Units::new(&solver.scene, solver.grid.unit_mm());
        let metric = metrics(self.activity, self.u);
        let voltage = solver.scene.voltage_v();
        NANO * content([&laws[0], &laws[1]], self.activity, &metric, voltage, units).driven
    }
}

/// Writes ∂e/∂u, the electric forces on the nodes, into `out`, for the laws without and with voltage.
pub(super) fn forces<L: Material>(laws: [&L; 2], activity: &Activity, u: &[f64], out: &mut [f64]) {
    let mut loaded = vec![0.0; u.len()];
    Operator::new(laws[0], activity).forces(u, out);
    Operator::new(laws[1], activity).forces(u, &mut loaded);
    out.iter_mut().zip(loaded).for_each(|(force, loaded)| *force -= loaded);
    activity.grid().restrict(u, out);
}

/// Returns the electric energy of each cell, `[y][x]`, with the full activity.
pub(super) fn of_cells<L: Material>(laws: [&L; 2], activity: &Activity, u: &[f64]) -> Vec<f64> {
    match activity.grid().order() {
        Order::Bilinear => cells::<Bilinear, L, 4>(laws, activity, u),
        Order::Biquadratic => cells::<Biquadratic, L, 9>(laws, activity, u),
    }
}

fn cells<E: Element<N>, L: Material, const N: usize>(laws: [&L; 2], activity: &Activity, u: &[f64]) -> Vec<f64> {
    let (grid, plane) = (activity.grid(), u.len() / 2);
    let of_points = weights(grid.order());
    let of_points: [f64; N] = std::array::from_fn(|q| of_points[q]);
    let mut energies = vec![0.0; grid.raster().cells()];
    for element in grid.each_element() {
        // The rest of a cell in which a frame or body ends has no electrode.
        if grid.follows_borders().is_some() && grid.content(element).part != Part::Membrane {
            continue;
        }
        let nodes = grid.nodes_of::<N>(element);
        let local = [0, 1].map(|c| nodes.map(|at| u[at + c * plane]));
        let (points, areas) = (
            grid.gradients::<E, N>(element, &local),
            grid.areas_of(element, of_points),
        );
        let energy = |gradient| {
            let [unloaded, loaded] = laws.map(|law| law.energy(deformation(gradient), 1.0));
            unloaded - loaded
        };
        let [x, y] = grid.cell_of(element);
        energies[y * grid.raster().columns() + x] += points
            .into_iter()
            .zip(areas)
            .map(|(gradient, area)| area * energy(gradient))
            .sum::<f64>();
    }
    energies
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adjoint::InMm;
    use crate::continuation::{LoadingEnd, Problem};
    use crate::energy::NeoHookean;
    use crate::grid::Grid;
    use crate::material::AnyMaterial;
    use crate::newton::Workspace;
    use crate::precondition::Laplacian;
    use crate::{GradientEvaluator, SolveOptions};
    use deaflow_base::Stream;
    use deaflow_field::{Differentiable, Field, Mesh, Predictor};
    use deaflow_pattern::{CELLS, Raster};
    use deaflow_scene::Scene;

    #[test]
    fn its_derivative_agrees_with_finite_differences() {
        let scene = Scene::vhb4910();
        let kappa = scene.kappa();
        for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
            let grid = Grid::paper(mesh);
            let laplacian = Laplacian::new(&grid).unwrap();
            let mut workspace = Workspace::new(grid.layout().vector_len(), &laplacian);
            let mut stream = Stream::new(5, "charge test", 0);
            let shares: Vec<f64> = (0..CELLS * CELLS)
                .map(|_| f64::from(u8::from(stream.chance(0.5))))
                .collect();
            let units = Units::new(&scene, grid.unit_mm());
            let law = |share: f64| AnyMaterial::from(NeoHookean::new(3.0, share * kappa));
            let law: &(dyn Fn(f64) -> AnyMaterial + Sync) = &law;
            let laws = [0.0, 1.0].map(law);
            let mut solve = |shares: &[f64]| {
                let activity = Activity::from_shares(&grid, |x, y| shares[y * CELLS + x]);
                let mut u = vec![0.0; grid.layout().vector_len()];
                let problem = Problem {
                    activity: &activity,
                    laplacian: &laplacian,
                    material: law,
                    tolerance: 1e-12,
                    at_rest: None,
                };
                assert_eq!(problem.load(&mut u, &mut workspace).ending, LoadingEnd::Stable);
                let metric = metrics(&activity, &u);
                let found = content([&laws[0], &laws[1]], &activity, &metric, scene.voltage_v(), units);
                (u, 1e9 * found.driven)
            };
            let (u, _) = solve(&shares);
            let differences: Vec<(usize, f64)> = [0, 49, 777, 1234, 2010]
                .map(|cell| {
                    let mut at = |by: f64| {
                        let mut shares = shares.clone();
                        shares[cell] += by;
                        solve(&shares).1
                    };
                    let step = 1e-3;
                    let slope = 8.0 * (at(step) - at(-step)) - (at(2.0 * step) - at(-2.0 * step));
                    (cell, slope / (12.0 * step))
                })
                .into();
            let activity = Activity::from_shares(&grid, |x, y| shares[y * CELLS + x]);
            let weights = Field::zero(Raster::PAPER).with_charge(1.0);
            let found = InMm {
                activity: &activity,
                laplacian: &laplacian,
                u: &u,
                weights: &weights,
                forces: None,
                charge_unit: 2e9 * units.energy / scene.voltage_v(),
                workspace: &mut workspace,
            };
            let gradient = found.run(law).unwrap();
            for (cell, slope) in differences {
                assert!(
                    (gradient[cell] - slope).abs() < 1e-6 * slope.abs(),
                    "{cell}: {} {slope}",
                    gradient[cell]
                );
            }
        }
    }

    #[test]
    fn half_of_the_default_membrane_takes_the_known_charge() {
        let half = Pattern::from_fn(Raster::PAPER, |x, _| x < 25);
        let scene = Scene::vhb4910();
        let evaluator = GradientEvaluator::new(&scene).unwrap().measuring_charge();
        let predicted = evaluator.predict(std::slice::from_ref(&half)).unwrap().remove(0);
        // An independent program with bilinear elements: 2779 nC.
        assert!(
            (predicted.charge() / 2779.0 - 1.0).abs() < 1e-3,
            "{}",
            predicted.charge()
        );
        let near = evaluator.predict_near(&half, std::slice::from_ref(&half)).unwrap();
        let near = near[0].as_ref().unwrap().charge();
        assert!((near / predicted.charge() - 1.0).abs() < 1e-6, "{near}");
        let (field, gradient) = evaluator
            .gradient(&half, &|field| Field::zero(field.raster()).with_charge(1.0))
            .unwrap()
            .unwrap();
        assert!(gradient.len() == 2500 && (field.charge() / predicted.charge() - 1.0).abs() < 1e-9);
        // Only where it is asked for: other fields are as before.
        let plain = GradientEvaluator::new(&scene).unwrap();
        assert_eq!(plain.predict(std::slice::from_ref(&half)).unwrap()[0].charge(), 0.0);
        let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(1))).unwrap();
        let charge = solver.driven_charge(&half, &solver.solve(&half).displacement);
        assert!((charge / 2779.0 - 1.0).abs() < 2e-4, "{charge}");
    }
}
