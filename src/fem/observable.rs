//! What an engineer asks of a solution: stretches, fields and stresses, cell by cell.
//!
//! They are those of the mean deformation gradient of a cell. Stresses at points next to a corner of the electrode grow
//! with the refinement of the mesh without end; the mean does not.

use crate::pattern::{CELLS, Pattern};
use crate::scene::Scene;

use super::kinematics::{Tensor, cofactor, determinant, squared_stretches};
use super::mesh::Mesh;

/// The state of one cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellState {
    /// In-plane stretches from the undeformed state, larger first.
    pub stretches: [f64; 2],
    /// True electric field V/h in V/m; zero where there is no electrode.
    pub electric_field: f64,
    /// First Piola–Kirchhoff stress in Pa, `[component][material direction]`.
    pub piola: Tensor<f64>,
    /// Principal Cauchy stresses in the plane in Pa, larger first; a negative one means that a real membrane wrinkles.
    pub stresses: [f64; 2],
}

/// The state of each cell, `[y][x]`, from nodal displacements in units of an element's side.
#[must_use]
pub fn cell_states(scene: &Scene, mesh: Mesh, pattern: &Pattern, u: &[f64]) -> Vec<CellState> {
    (0..CELLS * CELLS)
        .map(|i| {
            let (x, y) = (i % CELLS, i / CELLS);
            state(scene, mean_deformation(mesh, u, x, y), pattern.is_active(x, y))
        })
        .collect()
}

fn state(scene: &Scene, f: Tensor<f64>, active: bool) -> CellState {
    let (prestretch, modulus) = (scene.prestretch(), scene.shear_modulus_pa());
    let f = f.map(|row| row.map(|v| prestretch * v));
    let j = determinant(f);
    let nominal = if active {
        scene.voltage_v() / (1e-3 * scene.thickness_mm())
    } else {
        0.0
    };
    let pressure = modulus / (j * j) + scene.permittivity() * (nominal * j).powi(2);
    let c = cofactor(f);
    let squared = squared_stretches(f);
    CellState {
        stretches: squared.map(f64::sqrt),
        electric_field: nominal * j,
        piola: std::array::from_fn(|i| std::array::from_fn(|k| modulus * f[i][k] - pressure * c[i][k] / j)),
        stresses: squared.map(|s| modulus * s - pressure),
    }
}

/// I + the mean of ∇u over a cell: by the divergence theorem an integral of u along its sides.
fn mean_deformation(mesh: Mesh, u: &[f64], x: usize, y: usize) -> Tensor<f64> {
    let degree = mesh.order().degree();
    let steps = mesh.elements_per_cell() * degree;
    let weights: &[f64] = if degree == 1 {
        &[0.5, 0.5]
    } else {
        &[1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0]
    };
    let along = |value: &dyn Fn(usize) -> f64| -> f64 {
        let side = (0..mesh.elements_per_cell())
            .flat_map(|e| weights.iter().enumerate().map(move |(a, w)| (e * degree + a, w)));
        side.map(|(at, w)| w * value(at)).sum::<f64>()
    };
    let area = (mesh.elements_per_cell() as f64).powi(2);
    let (left, low) = (x * steps, y * steps);
    let mut f = [[1.0, 0.0], [0.0, 1.0]];
    for (c, row) in f.iter_mut().enumerate() {
        let jump_x = |at: usize| u[mesh.index(c, left + steps, low + at)] - u[mesh.index(c, left, low + at)];
        let jump_y = |at: usize| u[mesh.index(c, left + at, low + steps)] - u[mesh.index(c, left + at, low)];
        row[0] += along(&jump_x) / area;
        row[1] += along(&jump_y) / area;
    }
    f
}
