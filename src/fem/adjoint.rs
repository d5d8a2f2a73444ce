//! The gradient of a functional of the displacement with respect to all cells, from one additional linear solution.
//!
//! With the equilibrium R(u, S) = 0 and a functional J(u), dJ/dS = −ψ · ∂R/∂S, where Aψ = ∂J/∂u with the symmetric
//! tangent A (for instance Bendsøe and Sigmund, Topology Optimization, 2003, section 1.2.2). The energy is linear in
//! the activity S, so ∂R/∂S is the difference between the active and the bare stress. Of electrodes that cover parts of
//! cells, S is the covered share, and ∂R/∂S that of laminates.
//!
//! A functional J = e · r of the nodal forces r of the membrane without supports, such as the force of a side, also
//! depends on S directly: dJ/dS = (e − ψ) · ∂r/∂S, where Aψ is K e, with the tangent K without supports, at the nodes
//! that move.

use deaflow_field::{Field, Order};
use deaflow_pattern::Part;

use super::driven_charge;
use super::effects::WithMaterial;
use super::element::{Bilinear, Biquadratic, Element};
use super::material::Material;
use super::newton::{self, NewtonFailure, Workspace};
use super::operator::{Activity, Operator};
use super::precondition::Laplacian;
use super::reactions::SideForces;

/// Computes dJ/dS of each cell, `[y][x]`, for J = Σ weights · u over the cell corners, with u in units of
/// [`super::grid::Grid::unit_mm`].
///
/// # Errors
/// If the tangent at `u` is not positive definite.
pub fn gradient<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    tolerance: f64,
    u: &[f64],
    weights: &Field,
    workspace: &mut Workspace,
) -> Result<Vec<f64>, NewtonFailure> {
    let load = operator.activity.grid().spread(weights, u);
    let adjoint = newton::solve_tangent(operator, laplacian, tolerance, u, &load, workspace)?;
    of_all_cells(operator, u, &adjoint)
}

/// Computes −ψ · ∂R/∂S of each cell, also where electrodes cover a part of it.
fn of_all_cells<L: Material>(
    operator: &Operator<'_, L>,
    u: &[f64],
    adjoint: &[f64],
) -> Result<Vec<f64>, NewtonFailure> {
    match operator.laminates() {
        Some(laminates) => laminates.gradient(u, adjoint).ok_or(NewtonFailure::NegativeCurvature),
        None => Ok(of_cells(operator, u, adjoint)),
    }
}

/// Computes the gradient of J with u in mm for a model; `None` if the tangent at `u` is not positive definite.
pub struct InMm<'a> {
    pub activity: &'a Activity,
    pub laplacian: &'a Laplacian,
    pub u: &'a [f64],
    pub weights: &'a Field,
    /// The forces of the sides, if J depends on them.
    pub forces: Option<&'a SideForces<'a>>,
    /// The charge in nC of a unit of electric energy.
    pub charge_unit: f64,
    pub workspace: &'a mut Workspace,
}

impl InMm<'_> {
    /// Computes the gradient of Σ weights · forces of the sides in mN.
    fn of_forces<L: Material>(
        &mut self,
        operator: &Operator<'_, L>,
        forces: &SideForces<'_>,
    ) -> Result<Vec<f64>, NewtonFailure> {
        let mut motion = vec![0.0; self.u.len()];
        forces.weigh(self.weights.reactions(), &mut motion);
        let mut load = vec![0.0; self.u.len()];
        let open = Operator::new(operator.material, forces.activity());
        open.tangent(self.u, &motion, &mut load);
        self.activity.grid().restrict(self.u, &mut load);
        let mut adjoint = newton::solve_tangent(operator, self.laplacian, EXACT, self.u, &load, self.workspace)?;
        adjoint.iter_mut().zip(&motion).for_each(|(psi, e)| *psi -= e);
        of_all_cells(operator, self.u, &adjoint)
    }
}

impl InMm<'_> {
    /// Computes the gradient of a weight times the charge in nC.
    fn of_charge<L: Material>(
        &mut self,
        laws: [&L; 2],
        operator: &Operator<'_, L>,
        weight: f64,
    ) -> Result<Vec<f64>, NewtonFailure> {
        let mut load = vec![0.0; self.u.len()];
        driven_charge::forces(laws, self.activity, self.u, &mut load);
        let adjoint = newton::solve_tangent(operator, self.laplacian, EXACT, self.u, &load, self.workspace)?;
        let direct = driven_charge::of_cells(laws, self.activity, self.u);
        let both = of_all_cells(operator, self.u, &adjoint)?.into_iter().zip(direct);
        let unit = weight * self.charge_unit;
        Ok(both.map(|(moved, direct)| unit * (moved + direct)).collect())
    }
}

impl WithMaterial for InMm<'_> {
    type Output = Option<Vec<f64>>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(mut self, material: F) -> Option<Vec<f64>> {
        let (unloaded, material) = (material(0.0), material(1.0));
        let operator = Operator::new(&material, self.activity);
        let weight = self.weights.charge();
        let of_charge = match weight.abs() > 0.0 {
            true => Some(self.of_charge([&unloaded, &material], &operator, weight).ok()?),
            false => None,
        };
        let of_forces = match self.forces {
            Some(forces) => Some(self.of_forces(&operator, forces).ok()?),
            None => None,
        };
        let found = gradient(&operator, self.laplacian, EXACT, self.u, self.weights, self.workspace);
        let unit = self.activity.grid().unit_mm();
        let mut found: Vec<f64> = found.ok()?.iter().map(|g| g * unit).collect();
        if let Some(of_forces) = of_forces {
            found.iter_mut().zip(of_forces).for_each(|(sum, own)| *sum += own);
        }
        if let Some(of_charge) = of_charge {
            found.iter_mut().zip(of_charge).for_each(|(sum, own)| *sum += own);
        }
        Some(found)
    }
}

/// Relative residual of the adjoint solution.
const EXACT: f64 = 1e-9;

/// Computes −ψ · ∂R/∂S, summed over the elements of each cell.
#[must_use]
pub fn of_cells<L: Material>(operator: &Operator<'_, L>, u: &[f64], adjoint: &[f64]) -> Vec<f64> {
    match operator.activity.grid().order() {
        Order::Bilinear => cells::<Bilinear, L, 4>(operator, u, adjoint),
        Order::Biquadratic => cells::<Biquadratic, L, 9>(operator, u, adjoint),
    }
}

fn cells<E: Element<N>, L: Material, const N: usize>(
    operator: &Operator<'_, L>,
    u: &[f64],
    adjoint: &[f64],
) -> Vec<f64> {
    let (grid, plane) = (operator.activity.grid(), u.len() / 2);
    let raster = grid.raster();
    let mut gradient = vec![0.0; raster.cells()];
    for element in grid.each_element() {
        let nodes = grid.nodes_of::<N>(element);
        let local = |vector: &[f64]| [0, 1].map(|c| nodes.map(|at| vector[at + c * plane]));
        let pull = grid.gradients::<E, N>(element, &local(u)).map(|gradient| {
            let (active, bare) = (
                operator.material.stress(gradient, 1.0),
                operator.material.stress(gradient, 0.0),
            );
            std::array::from_fn(|i| std::array::from_fn(|k| active[i][k] - bare[i][k]))
        });
        let (forces, adjoint) = (grid.forces::<E, N>(element, pull), local(adjoint));
        let work = |c: usize| -> f64 { forces[c].iter().zip(adjoint[c]).map(|(force, psi)| force * psi).sum() };
        // The rest of a cell in which a frame or body ends has no electrode.
        if grid.follows_borders().is_none() || grid.content(element).part == Part::Membrane {
            let [x, y] = grid.cell_of(element);
            gradient[y * raster.columns() + x] -= work(0) + work(1);
        }
    }
    gradient
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::continuation::{LoadingEnd, Problem};
    use crate::energy::NeoHookean;
    use crate::grid::Grid;
    use crate::material::AnyMaterial;
    use deaflow_base::Stream;
    use deaflow_field::{CORNERS, Mesh};
    use deaflow_pattern::{CELLS, Raster};

    #[test]
    fn it_agrees_with_finite_differences() {
        for (order, per_cell) in [(Order::Bilinear, 1), (Order::Bilinear, 2), (Order::Biquadratic, 1)] {
            let grid = Grid::paper(Mesh::new(per_cell, order));
            let laplacian = Laplacian::new(&grid).unwrap();
            let mut workspace = Workspace::new(grid.layout().vector_len(), &laplacian);
            let mut stream = Stream::new(3, "adjoint test", 0);
            let shares: Vec<f64> = (0..CELLS * CELLS)
                .map(|_| f64::from(u8::from(stream.chance(0.5))))
                .collect();
            let weights = (0..CORNERS * CORNERS * 2).map(|i| if i % 97 == 5 { stream.normal() } else { 0.0 });
            let weights = Field::from_values(Raster::PAPER, weights.collect()).unwrap();
            let load = grid.spread(&weights, &vec![0.0; grid.layout().vector_len()]);
            let material = AnyMaterial::from(NeoHookean::new(3.0, 0.0255));
            let law = |_: f64| AnyMaterial::from(NeoHookean::new(3.0, 0.0255));
            let law: &(dyn Fn(f64) -> AnyMaterial + Sync) = &law;
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
                let value: f64 = u.iter().zip(&load).map(|(u, w)| u * w).sum();
                (u, value)
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
                    // Fourth order: the error of the difference is far below that of the gradient.
                    let slope = 8.0 * (at(step) - at(-step)) - (at(2.0 * step) - at(-2.0 * step));
                    (cell, slope / (12.0 * step))
                })
                .into();
            let activity = Activity::from_shares(&grid, |x, y| shares[y * CELLS + x]);
            let operator = Operator::new(&material, &activity);
            let gradient = gradient(&operator, &laplacian, 1e-10, &u, &weights, &mut workspace).unwrap();
            let largest = differences.iter().map(|(_, slope)| slope.abs()).fold(0.0, f64::max);
            for (cell, slope) in differences {
                assert!(
                    (gradient[cell] - slope).abs() < 1e-6 * largest,
                    "{cell}: {} {slope}",
                    gradient[cell]
                );
            }
        }
    }
}
