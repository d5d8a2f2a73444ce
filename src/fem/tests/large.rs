//! Membranes of many cells.

use super::*;
use crate::krylov::{KrylovEnd, Scratch, conjugate_gradients};
use crate::precondition::Laplacian;

const DISC: &str = "side: 60 mm, frame: { opening: { disc: { centre: [30 mm, 30 mm], radius: 30 mm } } }";
const RING: &str = "side: 60 mm, frame: { opening: { disc: { centre: [30 mm, 30 mm], radius: 29 mm } } }, bodies: [{ \
                    disc: { centre: [33 mm, 30 mm], radius: 8 mm }, spring: 0.1 N/m }]";
/// A body of a few nodes.
const DOT: &str = "side: 60 mm, frame: { opening: { disc: { centre: [30 mm, 30 mm], radius: 30 mm } } }, bodies: [{ \
                   rectangle: [[30 mm, 30 mm], [30.9 mm, 30.9 mm]] }]";

fn scene(geometry: &str, cells: usize, effects: &str) -> Scene {
    Scene::from_text(&format!(
        "{{ geometry: {{ {geometry}, thickness: 1 mm, prestretch: 3, cells: {cells} }}, material: {{ model: \
         neo-hookean, shear_modulus: 138.6 kPa, relative_permittivity: 4.7 }}, drive: {{ voltage: 3.5 kV }}, effects: \
         {{ {effects} }} }}"
    ))
    .unwrap()
}

/// Conjugate-gradient iterations for the Laplacian and a random load.
fn iterations(geometry: &str, cells: usize, mesh: Mesh) -> u32 {
    let scene = scene(geometry, cells, "");
    let grid = Grid::uniform(mesh, &Sheet::of(&scene));
    let activity = Activity::new(&grid, &Pattern::from_fn(grid.raster(), |_, _| false));
    let material = AnyMaterial::from(NeoHookean::new(3.0, 0.0));
    let operator = Operator::new(&material, &activity);
    let laplacian = Laplacian::new(&grid).unwrap();
    let rest = vec![0.0_f32; grid.layout().vector_len()];
    let poses = grid.poses(&rest);
    let load = grid.random_load(&mut Stream::new(3, "large", 0), &vec![0.0; rest.len()]);
    let mut krylov = Scratch::new(rest.len());
    let size = norm(&load);
    let narrow = load.iter().map(|load| (load / size) as f32);
    krylov.residual.iter_mut().zip(narrow).for_each(|(r, load)| *r = load);
    let mut scratch = laplacian.scratch();
    let ending = conjugate_gradients(
        1e-4,
        &mut krylov,
        |p, image| operator.tangent(&rest, p, image),
        |r, z| laplacian.solve(r, &poses, z, &mut scratch),
    );
    assert_eq!(ending, KrylovEnd::Converged, "{geometry} {cells} {mesh}");
    krylov.iterations
}

#[test]
fn frames_of_many_nodes_need_few_iterations() {
    // 1920 to 3072 nodes along frames and bodies, more than the matrix between them is stored for. Without it there
    // were 32 to 41 iterations, and more on finer meshes.
    for (geometry, cells, mesh, most) in [
        (DISC, 120, Mesh::biquadratic(2), 12),
        (DISC, 192, Mesh::biquadratic(2), 14),
        (RING, 120, Mesh::biquadratic(2), 14),
        (DOT, 120, Mesh::biquadratic(2), 14),
    ] {
        let found = iterations(geometry, cells, mesh);
        assert!(found <= most, "{geometry} {cells} {mesh}: {found}");
    }
}

#[test]
fn discs_of_many_cells_are_solved_with_the_steps_of_small_ones() {
    let yeoh = "strain_stiffening: { model: yeoh, c2: -888 Pa, c3: 16.7 Pa }";
    let steps = [30, 120].map(|cells| {
        let scene = scene(DISC, cells, yeoh);
        let solver = solver(&scene, if cells == 30 { 2 } else { 4 });
        let pattern = Pattern::from_fn(solver.grid().raster(), |x, y| {
            let [x, y] = [x, y].map(|at| (at as f64 + 0.5) / cells as f64 - 0.5);
            x.hypot(y) < 0.25
        });
        let solution = solver.solve(&pattern);
        assert_eq!(solution.outcome, Outcome::Converged);
        (
            solution.newton_iterations,
            solution.krylov_iterations,
            solver.field(&solution).max_magnitude(),
        )
    });
    let [small, large] = steps;
    assert!(large.0 <= small.0 + 1, "{steps:?}");
    assert!(large.1 <= 2 * small.1, "{steps:?}");
    assert!((large.2 / small.2 - 1.0).abs() < 0.05, "{steps:?}");
}

#[test]
fn a_long_strip_moves_like_its_transpose() {
    let of = |cells: [usize; 2], size: [f64; 2]| {
        let [[columns, rows], [width, height]] = [cells.map(|n| n.to_string()), size.map(|mm| mm.to_string())];
        let geometry = format!("size: [{width} mm, {height} mm]");
        let scene = Scene::from_text(&format!(
            "{{ geometry: {{ {geometry}, thickness: 1 mm, prestretch: 3, cells: [{columns}, {rows}] }}, material: {{ \
             model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ voltage: 4 kV }}, \
             effects: {{}} }}"
        ))
        .unwrap();
        let solver = solver(&scene, 2);
        let pattern = Pattern::from_fn(solver.grid().raster(), |x, y| (x + y) / 7 % 2 == 0 && (x.min(y)) < 2);
        let solution = solver.solve(&pattern);
        assert_eq!(solution.outcome, Outcome::Converged);
        (solution.krylov_iterations, solver.field(&solution))
    };
    let ((along_iterations, along), (across_iterations, across)) =
        (of([150, 3], [150.0, 3.0]), of([3, 150], [3.0, 150.0]));
    assert_eq!(along_iterations, across_iterations);
    let largest = along.max_magnitude();
    for (x, y) in (0..151).flat_map(|x| (0..4).map(move |y| (x, y))) {
        let ([a, b], [c, d]) = (along.at_corner(x, y), across.at_corner(y, x));
        assert!((a - d).abs().max((b - c).abs()) < 1e-8 * largest, "{x} {y}");
    }
}
