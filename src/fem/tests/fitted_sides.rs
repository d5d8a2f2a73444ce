//! Elements that follow borders, of membranes with sides that are not held.

use super::fitted::{disc, drawn};
use super::sides::{scene, solver_of};
use super::*;
use deaflow_pattern::Polygons;

const MESHES: [Mesh; 2] = [Mesh::bilinear(1), Mesh::biquadratic(1)];

fn bare(scene: &Scene) -> Pattern {
    Pattern::from_fn(scene.membrane().raster, |_, _| false)
}

fn simulated(scene: &Scene, mesh: Mesh) -> (Simulation, MembraneSolver) {
    let solver = solver_of(scene, mesh);
    assert!(solver.grid().follows_borders().is_some());
    let solution = solver.solve(&bare(scene));
    assert!(solution.outcome.is_converged(), "{}", solution.outcome);
    (solver.simulation(&bare(scene), &solution), solver)
}

/// Discs inside, across a side, and across a corner.
fn regions() -> [Polygons; 3] {
    [disc([14.0, 9.0], 4.0), disc([12.3, 19.2], 5.1), disc([29.0, 1.2], 6.3)]
}

#[test]
fn uniform_states_are_exact_on_elements_that_follow_borders() {
    let stretch = |scene: &Scene, mesh: Mesh| {
        let (found, _) = simulated(scene, mesh);
        let field = found.field.unwrap();
        let [x, y] = field.at_corner(15, 10);
        // The state is uniform.
        for (column, row) in (0..=15).flat_map(|column| (0..=10).map(move |row| (column, row))) {
            let [a, b] = field.at_corner(column, row);
            let (p, q) = (x * column as f64 / 15.0, y * row as f64 / 10.0);
            assert!((a - p).hypot(b - q) < 1e-9, "{column} {row}: {a} {p} {b} {q}");
        }
        [x / 30.0, y / 20.0]
    };
    let sides = "left: roller, bottom: roller";
    for (region, mesh) in regions()
        .into_iter()
        .flat_map(|region| MESHES.map(|mesh| (region.clone(), mesh)))
    {
        for (law, more, voltage) in [
            ("right: free, top: free", "prestretch: 2.5", 0.0),
            (
                "right: { load: [0.3 N, 0 N] }, top: { load: [0 N, 0.2 N] }",
                "prestretch: [2, 1.5]",
                0.0,
            ),
        ] {
            let geometry = format!("size: [30 mm, 20 mm], cells: [15, 10], {more}, sides: {{ {sides}, {law} }}");
            let plain = scene(&geometry, voltage);
            let fitted = stretch(&drawn(&plain, &[(1, region.clone())]), mesh);
            let solver = solver_of(&plain, mesh);
            let [x, y] = solver.field(&solver.solve(&bare(&plain))).at_corner(15, 10);
            assert!(
                (fitted[0] - x / 30.0).hypot(fitted[1] - y / 20.0) < 1e-10,
                "{law} {fitted:?}"
            );
        }
    }
}

#[test]
fn forces_balance_and_the_prestretch_has_no_effect_with_fitted_electrodes() {
    for mesh in MESHES {
        for [x, y, radius] in [[14.0, 9.0, 4.0], [12.3, 19.2, 5.1], [29.0, 1.2, 6.3]] {
            let mut known: Option<[f64; 2]> = None;
            for stretch in [1.0, 2.0, 3.0] {
                let by = |length: f64| stretch * length;
                let geometry = format!(
                    "size: [{} mm, {} mm], cells: [15, 10], prestretch: {stretch}, sides: {{ left: roller, right: {{ \
                     load: [0.2 N, 0.05 N] }}, bottom: free, top: {{ load: [0 N, -0.05 N] }} }}",
                    by(30.0),
                    by(20.0)
                );
                let region = disc([by(x), by(y)], by(radius));
                let scene = drawn(&scene(&geometry, 6000.0), &[(1, region)]);
                let (found, solver) = simulated(&scene, mesh);
                let [left, ..] = found.observation.reactions.unwrap();
                assert!((left[0] + 0.2).abs() < 1e-9, "{left:?}");
                let field = found.field.unwrap();
                let ([a, b], [c, d]) = (field.at_corner(0, 0), field.at_corner(15, 10));
                let size = [by(30.0) + c - a, by(20.0) + d - b];
                let first = *known.get_or_insert(size);
                let off = (size[0] - first[0]).hypot(size[1] - first[1]);
                assert!(
                    off < 1e-6,
                    "{mesh} {stretch}: {size:?} {first:?}, {}",
                    solver.grid().unit_mm()
                );
            }
        }
    }
}

/// A strip with a weight on a bar, a hub and a round electrode.
fn strip(cells: [usize; 2], curves: &str, held: &str) -> Scene {
    let [columns, rows] = cells;
    scene(
        &format!(
            "size: [40 mm, 20 mm], cells: [{columns}, {rows}], prestretch: 2, {held}, sides: {{ right: {{ bar: {{ \
             load: [0.3 N, 0.02 N] }} }}, top: free, bottom: free }}"
        )
        .replace("CURVES", curves),
        5000.0,
    )
}

#[test]
fn fitted_strips_are_the_limit_of_strips_of_small_cells() {
    let hub = "frame: { held: [{ disc: { centre: [12 mm, 11 mm], radius: 3 mm } }], curves: CURVES }";
    let body = "bodies: [{ disc: { centre: [12 mm, 11 mm], radius: 3 mm }, curves: CURVES }]";
    let region = disc([26.0, 9.0], 5.0);
    for held in [
        hub,
        body,
        "frame: { held: [{ disc: { centre: [12 mm, 20.5 mm], radius: 4.2 mm } }], curves: CURVES }",
    ] {
        let bar = |found: &Simulation| {
            let motion = found.observation.bars.as_ref().unwrap()[0];
            [
                motion.translation[0],
                motion.translation[1],
                10.0 * motion.rotation.to_radians(),
            ]
        };
        let fitted = |cells: [usize; 2]| {
            let scene = drawn(&strip(cells, "fitted", held), &[(1, region.clone())]);
            bar(&simulated(&scene, Mesh::biquadratic(1)).0)
        };
        let of_cells = |cells: [usize; 2]| {
            let scene = strip(cells, "cells", held);
            let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| {
                let [x, y] = scene.membrane().centre_mm(x, y);
                (x - 26.0).hypot(y - 9.0) < 5.0
            });
            let solver = solver_of(&scene, Mesh::biquadratic(1));
            let solution = solver.solve(&pattern);
            assert!(solution.outcome.is_converged());
            bar(&solver.simulation(&pattern, &solution))
        };
        let apart = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f64::max);
        let (coarse, fine) = (fitted([20, 10]), fitted([60, 30]));
        let (stairs, small) = (of_cells([20, 10]), of_cells([100, 50]));
        println!(
            "{held}: {fine:?}; fitted {:.1e}, cells {:.1e}, small cells {:.1e}",
            apart(coarse, fine),
            apart(stairs, fine),
            apart(small, fine)
        );
        // Staircases are of first order.
        assert!(apart(coarse, fine) < 5e-3 && apart(small, fine) < 0.3 * apart(stairs, fine));
    }
}

#[test]
fn tangents_and_gradients_follow_residuals_on_fitted_elements_at_sides() {
    let scene = drawn(
        &strip(
            [10, 5],
            "fitted",
            "bodies: [{ disc: { centre: [12 mm, 10 mm], radius: 4.2 mm }, curves: CURVES }]",
        ),
        &[(1, disc([40.0, 11.0], 7.3).union(&disc([24.0, 1.0], 4.5)))],
    );
    for mesh in MESHES {
        let solver = solver_of(&scene, mesh);
        let grid = solver.grid();
        let activity = Activity::new(grid, &bare(&scene));
        let material = AnyMaterial::from(NeoHookean::of(0.3, 0.2));
        let operator = Operator::new(&material, &activity);
        let len = grid.layout().vector_len();
        let u = waves(grid, 0.01, 0.2);
        let mut du = waves(grid, 0.01, 1.3);
        grid.restrict(&u, &mut du);
        let mut product = vec![0.0; len];
        operator.tangent(&u, &du, &mut product);
        let at = |step: f64| residual_after(&operator, &u, &du, step);
        let (ahead, behind) = (at(1e-5), at(-1e-5));
        let rigid: Vec<usize> = grid
            .supports()
            .unwrap()
            .bodies()
            .iter()
            .flat_map(|body| body.nodes.iter().map(|(at, _)| at).collect::<Vec<_>>())
            .collect();
        let worst = (0..len)
            .filter(|at| !rigid.contains(&(at % (len / 2))))
            .map(|at| ((ahead[at] - behind[at]) / 2e-5 - product[at]).abs())
            .fold(0.0, f64::max);
        assert!(
            worst < 1e-6 * norm(&product),
            "{mesh}: {worst:e} of {:e}",
            norm(&product)
        );
        let back = Factorisation::new(&operator, &u).unwrap().solve(&product);
        let worst = back.iter().zip(&du).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-9, "{mesh}: {worst:e}");
    }
}
