//! Cases with known results. H-numbers refer to the theory page; closed forms are repeated where they are used.

mod charge;
mod convergence;
mod coverage;
mod devices;
mod discrete;
mod effects;
mod fitted;
mod fitted_sides;
mod floating;
mod fringe;
mod geometry;
mod groups;
mod hard;
mod hubs;
mod interrupts;
mod invariance;
mod known;
mod large;
mod laws;
mod limits;
mod near;
mod out_of_plane;
mod outcome;
mod paths;
mod pressure;
mod rectangles;
mod scenes;
mod sides;
mod snapping;

use super::direct::Factorisation;
use super::effects::StableRange;
use super::energy::NeoHookean;
use super::grid::Grid;
use super::material::{AnyMaterial, Material};
use super::newton::norm;
use super::operator::{Activity, Operator};
use super::reactions::SideForces;
use super::rigid::Pose;
use super::sheet::Sheet;
use super::*;
use deaflow_base::Stream;
use deaflow_field::{CORNERS, Field, Mesh, Order, Outcome, Reactions, Simulation, Simulator};
use deaflow_pattern::{CELLS, Membrane, Pattern, Raster, Symmetry};
use deaflow_scene::Scene;

/// A displacement of waves that a grid allows.
fn waves(grid: &Grid, size: f64, phase: f64) -> Vec<f64> {
    let len = grid.layout().vector_len();
    let mut u: Vec<f64> = (0..len).map(|i| size * (i as f64 * 0.61 + phase).sin()).collect();
    grid.restrict(&vec![0.0; len], &mut u);
    grid.settle(&mut u);
    u
}

/// The residual after a step along a change.
fn residual_after<L: Material>(operator: &Operator<'_, L>, u: &[f64], change: &[f64], step: f64) -> Vec<f64> {
    let mut moved: Vec<f64> = u.iter().zip(change).map(|(u, du)| u + step * du).collect();
    operator.activity.grid().settle(&mut moved);
    let mut residual = vec![0.0; u.len()];
    operator.residual(&moved, &mut residual);
    residual
}

fn half() -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, _| x < CELLS / 2)
}

/// A square membrane of VHB 4910, 1 mm thick, with ten cells along a side.
pub(crate) fn square_of_ten(drive: &str, effects: &str, more: &str) -> Scene {
    Scene::from_text(&format!(
        "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }}, material: {{ model: neo-hookean, \
         shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ {drive} }}, effects: {{ {effects} }}{more} }}"
    ))
    .unwrap()
}

/// The critical voltage of a pattern that is unstable at the voltage of the scene.
fn critical_voltage(search: &CriticalSearch, pattern: &Pattern) -> Option<CriticalVoltage> {
    match search.stable_range(pattern) {
        StableRange::Lost(found) => Some(search.refine(pattern, found.voltage)),
        StableRange::Nowhere | StableRange::UpTo(_) => None,
    }
}

fn random(index: u64) -> Pattern {
    random_on(Raster::PAPER, index)
}

/// A pattern of random active cells.
fn random_on(raster: Raster, index: u64) -> Pattern {
    let mut stream = Stream::new(7, "fem test", index);
    let bits: Vec<bool> = (0..raster.cells()).map(|_| stream.chance(0.5)).collect();
    Pattern::from_fn(raster, |x, y| bits[y * raster.columns() + x])
}

/// The membrane of the source paper, and rectangles with cells that are not square and unequal prestretch.
fn sheets() -> impl Iterator<Item = Sheet> {
    let rectangle = |sides: [usize; 2], size_mm, prestretch| Sheet {
        membrane: Membrane {
            raster: Raster::new(sides[0], sides[1]).unwrap(),
            size_mm,
        },
        prestretch,
        ..Sheet::paper()
    };
    [
        Sheet::paper(),
        rectangle([24, 17], [60.0, 30.0], [3.0, 4.0]),
        rectangle([7, 33], [10.0, 90.0], [2.0, 5.0]),
        rectangle([40, 3], [30.0, 30.0], [4.0, 1.0]),
    ]
    .into_iter()
}

fn options(elements_per_cell: usize, order: Order) -> SolveOptions {
    SolveOptions {
        mesh: Mesh::new(elements_per_cell, order),
        tolerance: 1e-10,
    }
}

fn solver(scene: &Scene, elements_per_cell: usize) -> MembraneSolver {
    MembraneSolver::new(scene, options(elements_per_cell, Order::Bilinear)).unwrap()
}

fn field(scene: &Scene, elements_per_cell: usize, pattern: &Pattern) -> Field {
    let result = solver(scene, elements_per_cell)
        .simulate(std::slice::from_ref(pattern))
        .remove(0);
    assert_eq!(result.outcome, Outcome::Converged);
    result.field.unwrap()
}

fn soft(voltage: f64) -> Scene {
    Scene::with_values(50.0, 1.0, 3.0, 25e3, 4.7, voltage)
}

fn places(grid: &Grid) -> impl Iterator<Item = (usize, usize)> {
    let [columns, rows] = grid.layout().nodes();
    (0..columns * rows).map(move |i| (i / columns, i % columns))
}

/// Full Newton steps with the factorised tangent, whatever its inertia, until the residual is the given load.
fn newton_by_factors<L: Material>(operator: &Operator<'_, L>, load: &[f64], u: &mut [f64]) {
    let mut r = vec![0.0; u.len()];
    for _ in 0..12 {
        operator.residual(u, &mut r);
        r.iter_mut().zip(load).for_each(|(r, l)| *r -= l);
        if norm(&r) < 1e-12 {
            return;
        }
        let step = Factorisation::new(operator, u).unwrap().solve(&r);
        u.iter_mut().zip(step).for_each(|(u, s)| *u -= s);
        operator.activity.grid().settle(u);
    }
    panic!("residual {:e}", norm(&r));
}

/// Compares the gradient of a weighted sum of displacements with fourth-order differences in the activity of some
/// cells.
fn check_gradient(
    scene: &Scene,
    solver: &MembraneSolver,
    pattern: &Pattern,
    weights: &Field,
    cells: impl Iterator<Item = usize>,
) {
    let solution = solver.solve(pattern);
    let gradient = solver.gradient(pattern, &solution, weights).unwrap();
    let (grid, columns) = (solver.grid(), pattern.raster().columns());
    let material = AnyMaterial::from(NeoHookean::new(scene.mean_prestretch(), scene.kappa()));
    let value = |cell: usize, by: f64| -> f64 {
        let share = |x: usize, y: usize| {
            let own = f64::from(u8::from(pattern.is_active(x, y)));
            own + if y * columns + x == cell { by } else { 0.0 }
        };
        let activity = Activity::from_shares(grid, share);
        let operator = Operator::new(&material, &activity);
        let mut u = solution.displacement.clone();
        newton_by_factors(&operator, &vec![0.0; u.len()], &mut u);
        let field = grid.sample(&u);
        let of_motion: f64 = field.values().iter().zip(weights.values()).map(|(u, w)| u * w).sum();
        if *weights.reactions() == Reactions::default() {
            return of_motion;
        }
        let forces = SideForces::of(solver, Activity::from_shares(&grid.opened(), share)).unwrap();
        let forces = forces.at(&material, 1.0, &u);
        let pairs = forces.as_flattened().iter().zip(weights.reactions().as_flattened());
        of_motion + pairs.map(|(force, weight)| 1e3 * force * weight).sum::<f64>()
    };
    let largest = gradient.iter().fold(0.0, |largest: f64, g| largest.max(g.abs()));
    for cell in cells {
        let step = 1e-3;
        let slope = (8.0 * (value(cell, step) - value(cell, -step)) - value(cell, 2.0 * step)
            + value(cell, -2.0 * step))
            / (12.0 * step);
        assert!(
            (gradient[cell] - slope).abs() < 1e-6 * largest,
            "{:?} {cell}: {} {slope}",
            scene.geometry,
            gradient[cell]
        );
    }
}
