//! Displacements at points of the membrane, and how they change with the scene: what measurements are compared with.

use deaflow_pattern::Pattern;

use super::effects::WithMaterial;
use super::material::Material;
use super::newton;
use super::operator::{Activity, Operator};
use super::sampling::Weights;
use super::solver::{MembraneSolver, MeshSolution};

/// Relative residual of the derivative of a solution.
const EXACT: f64 = 1e-9;

impl MembraneSolver {
    /// Returns the displacement in mm at weights of [`Grid::weights_at`](crate::grid::Grid::weights_at) for nodal
    /// values of this solver.
    #[must_use]
    pub fn displacement_at(&self, weights: &Weights, nodal: &[f64]) -> [f64; 2] {
        let plane = nodal.len() / 2;
        [0, 1].map(|c| {
            let terms = weights.iter().map(|(at, weight)| weight * nodal[at + c * plane]);
            self.grid().unit_mm() * terms.sum::<f64>()
        })
    }

    /// Returns the change of a converged solution, to first order, when its scene changes from that of the first to
    /// that of the second neighbour: −A⁻¹(R₂ − R₁) with the tangent A, for the nodal values of [`MeshSolution`]. For
    /// the derivative with respect to a parameter, the neighbours have it a little smaller and larger, and the result
    /// is divided by the difference. `None` if the charge is prescribed, the neighbours have other elements, or the
    /// tangent is not positive definite.
    #[must_use]
    pub fn change(&self, pattern: &Pattern, solution: &MeshSolution, neighbours: [&Self; 2]) -> Option<Vec<f64>> {
        let has_charge = self.scene.drive.charge.is_some();
        let is_same = |other: &&Self| other.grid.layout() == self.grid.layout();
        if has_charge || !solution.outcome.is_converged() || !neighbours.iter().all(is_same) {
            return None;
        }
        let residual = |solver: &Self| {
            solver.model.with(Residual {
                activity: &solver.model.activity(&solver.grid, pattern),
                u: &solution.displacement,
            })
        };
        let [first, second] = neighbours.map(residual);
        let load: Vec<f64> = first
            .iter()
            .zip(&second)
            .map(|(first, second)| first - second)
            .collect();
        if load.iter().all(|force| *force == 0.0) {
            return Some(load);
        }
        self.model.with(Response {
            solver: self,
            activity: &self.model.activity(&self.grid, pattern),
            u: &solution.displacement,
            load: &load,
        })
    }
}

/// Computes the residual at a displacement.
struct Residual<'a> {
    activity: &'a Activity,
    u: &'a [f64],
}

impl WithMaterial for Residual<'_> {
    type Output = Vec<f64>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Vec<f64> {
        let mut residual = vec![0.0; self.u.len()];
        Operator::new(&material(1.0), self.activity).residual(self.u, &mut residual);
        residual
    }
}

/// Computes the linear response to nodal forces at a solution.
struct Response<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    u: &'a [f64],
    load: &'a [f64],
}

impl WithMaterial for Response<'_> {
    type Output = Option<Vec<f64>>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<Vec<f64>> {
        let Self { solver, u, load, .. } = self;
        let material = material(1.0);
        let operator = Operator::new(&material, self.activity);
        let workspace = &mut solver.workspace();
        newton::solve_tangent(&operator, &solver.laplacian, EXACT, u, load, workspace).ok()
    }
}

#[cfg(test)]
mod tests {
    use deaflow_base::Stream;
    use deaflow_field::{Mesh, Order};
    use deaflow_pattern::{Pattern, Raster};
    use deaflow_scene::Scene;

    use crate::grid::Grid;
    use crate::{MembraneSolver, SolveOptions};

    const DISC: &str =
        "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50, frame: { opening: { disc: { \
                        centre: [25 mm, 25 mm], radius: 20 mm } }, curves: fitted } }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5 kV }
effects: {}
";
    const FRINGE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5 kV }
effects: { fringe_field: {} }
";
    const WIDE: &str = "geometry: { size: [60 mm, 20 mm], thickness: 1 mm, prestretch: [3, 4], cells: [30, 10] }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5 kV }
effects: {}
";

    fn solver(text: &str, order: Order) -> MembraneSolver {
        let scene = Scene::from_text(text).unwrap();
        MembraneSolver::new(
            &scene,
            SolveOptions {
                mesh: Mesh::new(2, order),
                tolerance: 1e-11,
            },
        )
        .unwrap()
    }

    /// Nodal values of u = (0.1 + 0.02 x − 0.03 y, 0.01 xy) in mm.
    fn bilinear_field(grid: &Grid) -> Vec<f64> {
        let layout = grid.layout();
        let mut u = vec![0.0; layout.vector_len()];
        let [columns, rows] = layout.nodes();
        for node in (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row])) {
            let [x, y] = grid.node_position(node).map(|at| at * grid.unit_mm());
            let [column, row] = node;
            u[layout.index(0, column, row)] = (0.1 + 0.02 * x - 0.03 * y) / grid.unit_mm();
            u[layout.index(1, column, row)] = 0.01 * x * y / grid.unit_mm();
        }
        u
    }

    #[test]
    fn linear_fields_are_exact_at_all_points() {
        for (text, order, size) in [
            (WIDE, Order::Bilinear, [60.0, 20.0]),
            (WIDE, Order::Biquadratic, [60.0, 20.0]),
            (FRINGE, Order::Bilinear, [50.0; 2]),
            (DISC, Order::Bilinear, [50.0; 2]),
            (DISC, Order::Biquadratic, [50.0; 2]),
        ] {
            let solver = solver(text, order);
            let (grid, is_disc) = (solver.grid(), text == DISC);
            let u = bilinear_field(grid);
            let mut stream = Stream::new(5, "points", 0);
            let mut counted = 0;
            let corners = [[0.0, 0.0], size, [0.0, size[1]]];
            let random = (0..500).map(|_| [0, 1].map(|axis: usize| size[axis] * stream.uniform()));
            for [x, y] in corners.into_iter().chain(random) {
                let within = (x - 25.0).hypot(y - 25.0) - 20.0;
                let Some(weights) = grid.weights_at([x, y]) else {
                    assert!(is_disc && within > -1e-2, "no element at {x}, {y}");
                    continue;
                };
                assert!(!is_disc || within < 1e-2, "the frame at {x}, {y}");
                let found = solver.displacement_at(&weights, &u);
                assert!(
                    (found[0] - (0.1 + 0.02 * x - 0.03 * y)).abs() < 1e-11,
                    "{x} {y}: {found:?}"
                );
                // xy is not among the functions of triangles and moved elements.
                let bound = if is_disc { 5e-3 } else { 1e-11 };
                assert!((found[1] - 0.01 * x * y).abs() < bound, "{x} {y}: {found:?}");
                counted += 1;
            }
            assert!(counted > 200);
            assert!(grid.weights_at([-1e-9, 1.0]).is_none() && grid.weights_at([1.0, size[1] + 1e-9]).is_none());
        }
    }

    #[test]
    fn the_change_with_a_parameter_agrees_with_differences_of_solutions() {
        let device = DISC.replace("effects: {}", "effects: { strain_stiffening: { model: gent, jm: 90 } }");
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| x < 25 && (12..38).contains(&y));
        let held = pattern.clone();
        for (key, value, step) in [
            ("shear_modulus", 45.0, 0.05),
            ("voltage", 5.0, 0.005),
            ("thickness", 1.0, 1e-3),
            ("prestretch", 3.0, 1e-3),
            ("jm", 90.0, 0.1),
        ] {
            let with = |value: f64| {
                let line = |old: &str| format!("{key}: {old}");
                let new = match key {
                    "shear_modulus" => device.replace(&line("45 kPa"), &line(&format!("{value} kPa"))),
                    "voltage" => device.replace(&line("5 kV"), &line(&format!("{value} kV"))),
                    "thickness" => device.replace(&line("1 mm"), &line(&format!("{value} mm"))),
                    "prestretch" => device.replace(&line("3"), &line(&value.to_string())),
                    _ => device.replace(&line("90"), &line(&value.to_string())),
                };
                solver(&new, Order::Bilinear)
            };
            let (middle, neighbours) = (with(value), [with(value - step), with(value + step)]);
            let solution = middle.solve(&held);
            let change = middle
                .change(&held, &solution, [&neighbours[0], &neighbours[1]])
                .unwrap();
            let solved = neighbours.each_ref().map(|solver| solver.solve(&held).displacement);
            let expected: Vec<f64> = solved[1].iter().zip(&solved[0]).map(|(b, a)| b - a).collect();
            let largest = expected.iter().fold(0.0_f64, |most, d| most.max(d.abs()));
            assert!(largest > 1e-6, "{key}");
            for (found, expected) in change.iter().zip(&expected) {
                assert!(
                    (found - expected).abs() < 1e-5 * largest,
                    "{key}: {found} {expected} of {largest}"
                );
            }
        }
    }
}
