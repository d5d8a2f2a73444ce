//! Fringe fields: errors of all meshes for any width of the strip.

use crate::{AccurateSolver, MembraneSolver, SolveOptions};
use deaflow_base::Stream;
use deaflow_field::{Field, Mesh};
use deaflow_pattern::{Pattern, Raster};
use deaflow_scene::{On, Scene};

use std::f64::consts::{LN_2, PI};

/// The default membrane with a thickness that makes the strip this share of a cell wide, at a share of its critical
/// voltage.
fn scene(strip: f64, share: f64, fringe: bool) -> Scene {
    let thickness = 9.0 * strip * PI / LN_2;
    let base = Scene::vhb4910();
    let field = base.voltage_v() / base.thickness_mm();
    let mut scene = Scene::with_values(
        base.side_mm(),
        thickness,
        base.mean_prestretch(),
        base.shear_modulus_pa(),
        4.7,
        share * field * thickness,
    );
    scene.effects.fringe_field = fringe.then_some(On {});
    scene
}

fn patterns() -> Vec<Pattern> {
    let mut stream = Stream::new(5, "fringe test", 0);
    let bits: Vec<bool> = (0..2500).map(|_| stream.chance(0.5)).collect();
    vec![
        Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (25, 25)),
        Pattern::from_fn(Raster::PAPER, |x, y| bits[50 * y + x]),
        Pattern::from_fn(Raster::PAPER, |x, y| (x + y) % 2 == 0),
        Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (0, 49)),
    ]
}

fn solve(scene: &Scene, mesh: Mesh) -> Vec<Field> {
    let solver = MembraneSolver::new(scene, SolveOptions::on(mesh)).unwrap();
    patterns()
        .iter()
        .map(|pattern| solver.simulation(pattern, &solver.solve(pattern)).field.unwrap())
        .collect()
}

fn largest(field: &Field) -> f64 {
    field.max_difference(&Field::zero(Raster::PAPER))
}

/// Largest difference to a finer solution, relative to the largest displacement.
fn errors(coarse: &[Field], fine: &[Field]) -> Vec<f64> {
    let pairs = coarse.iter().zip(fine);
    pairs
        .map(|(coarse, fine)| coarse.max_difference(fine) / largest(fine))
        .collect()
}

#[test]
fn errors_are_those_without_a_fringe_field_on_every_mesh() {
    let meshes = [
        Mesh::bilinear(1),
        Mesh::bilinear(2),
        Mesh::biquadratic(1),
        Mesh::biquadratic(2),
    ];
    let finest = Mesh::biquadratic(4);
    let off = scene(0.125, 0.9, false);
    let truth = solve(&off, finest);
    let plain: Vec<Vec<f64>> = meshes.iter().map(|&mesh| errors(&solve(&off, mesh), &truth)).collect();
    for strip in [1.0 / 64.0, 0.29, 0.5] {
        let on = scene(strip, 0.9, true);
        let truth = solve(&on, finest);
        for (mesh, plain) in meshes.iter().zip(&plain) {
            let found = errors(&solve(&on, *mesh), &truth);
            let pairs = found.iter().zip(plain);
            // Single cells and chessboards grow with it, so that the distances of their singular corners change.
            assert!(
                pairs.into_iter().all(|(found, plain)| *found < 2.0 * plain),
                "{strip}, {mesh}: {found:?} {plain:?}"
            );
        }
    }
}

#[test]
fn an_accuracy_that_is_stated_is_met() {
    // Strips of a ninth of a cell and a fiftieth.
    for (thickness, volts) in [(5.0995, 22_948.0), (0.8, 3.6e3)] {
        let base = Scene::vhb4910();
        let mut scene = Scene::with_values(base.side_mm(), thickness, 3.0, base.shear_modulus_pa(), 4.7, volts);
        scene.effects.fringe_field = Some(On {});
        let truth = solve(&scene, Mesh::biquadratic(4));
        for accuracy in [0.01, 0.001] {
            let solver = AccurateSolver::new(&scene, accuracy, 1e-8).unwrap();
            let results = solver.simulate(&patterns()).unwrap();
            for (at, (result, truth)) in results.iter().zip(&truth).enumerate() {
                let stated = result.discretisation_error.unwrap();
                let error = result.simulation.field.as_ref().unwrap().max_difference(truth);
                assert!(
                    error <= stated && stated <= accuracy,
                    "{thickness} {at}: {error} {stated}"
                );
            }
        }
    }
}
