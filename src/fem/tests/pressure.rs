//! Membranes under pressure. Known answers are those of independent programs, axisymmetric and on squares.

use super::*;
use crate::out_of_plane::{Inflated, InflationOutcome, InflationSolver};

const LAW: &str = "material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }";

fn scene_of(geometry: &str, volts: f64, loads: &str) -> Scene {
    Scene::from_text(&format!(
        "{{ geometry: {{ thickness: 1 mm, cells: 50, {geometry} }}, {LAW}, drive: {{ voltage: {volts} V }}, loads: {{ \
         {loads} }} }}"
    ))
    .unwrap()
}

/// A disc of a radius of 25 mm in a square of 62.5 mm.
fn disc(lambda: f64) -> String {
    format!(
        "side: 62.5 mm, prestretch: {lambda}, frame: {{ opening: {{ disc: {{ centre: [31.25 mm, 31.25 mm], radius: 25 \
         mm }} }}, curves: fitted }}"
    )
}

fn inflated(scene: &Scene, mesh: Mesh, pattern: &Pattern) -> Inflated {
    let solver = InflationSolver::new(scene, SolveOptions::on(mesh)).unwrap();
    solver.solve(pattern)
}

fn active(is_active: bool) -> Pattern {
    Pattern::from_fn(Raster::PAPER, |_, _| is_active)
}

/// The displacement at a corner of cells.
fn at(found: &Inflated, [x, y]: [usize; 2]) -> [f64; 3] {
    let [u, v] = found.displacement.at_corner(x, y);
    [u, v, found.heights[y * 51 + x]]
}

fn close(found: [f64; 3], known: [f64; 3], error: f64) {
    for (found, known) in found.iter().zip(known) {
        assert!((found - known).abs() <= error, "{found} {known}");
    }
}

#[test]
fn squares_under_pressure_have_the_known_displacements() {
    let square = "side: 50 mm, prestretch: 3";
    let cases = [
        (
            active(false),
            0.0,
            1000.0,
            [0.0, 0.0, 4.194026],
            [-0.243096, 0.0, 2.808655],
        ),
        (
            half(),
            4000.0,
            500.0,
            [1.202099, 0.0, 2.221576],
            [0.280238, 0.0, 1.595451],
        ),
        (
            active(true),
            5250.0,
            500.0,
            [0.0, 0.0, 2.698194],
            [-0.113627, 0.0, 1.812123],
        ),
    ];
    for (pattern, volts, pascals, centre, side) in cases {
        let scene = scene_of(square, volts, &format!("pressure: {pascals} Pa"));
        let found = inflated(&scene, Mesh::biquadratic(1), &pattern);
        assert_eq!(found.outcome, InflationOutcome::Converged);
        close(at(&found, [25, 25]), centre, 1e-6);
        close(at(&found, [10, 25]), side, 1e-6);
        // Upside down.
        let scene = scene_of(square, volts, &format!("pressure: -{pascals} Pa"));
        let below = inflated(&scene, Mesh::biquadratic(1), &pattern);
        let [x, y, z] = centre;
        close(at(&below, [25, 25]), [x, y, -z], 1e-6);
        assert!((below.volume + found.volume).abs() < 1e-8 * found.volume);
    }
    let coarse = inflated(
        &scene_of(square, 4000.0, "pressure: 500 Pa"),
        Mesh::bilinear(1),
        &half(),
    );
    close(at(&coarse, [25, 25]), [1.202191, 0.0, 2.222251], 1e-6);
}

#[test]
fn round_membranes_under_pressure_have_the_axisymmetric_displacements() {
    for (pattern, volts, pascals, centre, along, height) in [
        (active(false), 0.0, 100.0, 0.3477660425, 0.0016220711, 0.2921144872),
        (active(false), 0.0, 1000.0, 3.5465503394, 0.1681825943, 2.9695955669),
        (active(true), 5000.0, 1000.0, 4.6084802043, 0.3232403625, 3.8404490879),
    ] {
        let scene = scene_of(&disc(3.0), volts, &format!("pressure: {pascals} Pa"));
        let found = inflated(&scene, Mesh::biquadratic(1), &pattern);
        assert_eq!(found.outcome, InflationOutcome::Converged);
        close(at(&found, [25, 25]), [0.0, 0.0, centre], 2e-5);
        // 10 mm from the centre.
        close(at(&found, [33, 25]), [along, 0.0, height], 2e-5);
    }
}

#[test]
fn a_given_volume_has_the_known_pressure_also_past_its_maximum() {
    for (lambda, millilitres, pascals) in [
        (1.1, 10.0, 1581.4616),
        (1.1, 50.0, 3414.7454),
        (1.1, 100.0, 2976.6189),
        (3.0, 10.0, 2426.0127),
        (3.0, 50.0, 3478.1601),
        (3.0, 100.0, 2989.1734),
    ] {
        let scene = scene_of(&disc(lambda), 0.0, &format!("volume: {millilitres} ml"));
        let found = inflated(&scene, Mesh::biquadratic(1), &active(false));
        assert_eq!(found.outcome, InflationOutcome::Converged, "{lambda} {millilitres}");
        assert!((found.volume / millilitres - 1.0).abs() < 1e-9);
        assert!(
            (found.pressure / pascals - 1.0).abs() < 1e-4,
            "{lambda} {millilitres}: {}",
            found.pressure
        );
        if (lambda, millilitres) == (1.1, 10.0) {
            assert!((at(&found, [25, 25])[2] - 9.531169).abs() < 1e-3);
        }
    }
}

#[test]
fn a_pressure_beyond_the_largest_is_a_limit_point() {
    let scene = scene_of(&disc(3.0), 0.0, "pressure: 4500 Pa");
    let found = inflated(&scene, Mesh::bilinear(1), &active(false));
    let InflationOutcome::LimitPoint {
        last_stable,
        first_unstable,
    } = found.outcome
    else {
        panic!("{:?}", found.outcome);
    };
    let [last_stable, first_unstable] = [last_stable, first_unstable].map(|share| 4500.0 * share);
    // 3599.6 Pa; bilinear elements are a little too stiff.
    assert!(
        last_stable > 3590.0 && first_unstable < 3620.0,
        "{last_stable} {first_unstable}"
    );
    assert!(first_unstable - last_stable < 2e-3 * last_stable);
}
