//! Bodies that move out of the plane. Known answers are those of independent programs, axisymmetric and on squares.

use std::f64::consts::PI;

use super::*;
use crate::out_of_plane::{Inflated, InflationOutcome, InflationSolver};

const DISC: &str = "side: 62.5 mm, cells: 50, frame: { opening: { disc: { centre: [31.25 mm, 31.25 mm], radius: 25 \
                    mm } }, curves: fitted }, bodies: [{ disc: { centre: [31.25 mm, 31.25 mm], radius: 5 mm }, \
                    curves: fitted";
const SQUARE: &str = "side: 50 mm, cells: 50, bodies: [{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]]";

/// A scene with one body, whose list is open, and the rest of the scene.
fn scene_of(geometry: &str, body: &str, volts: f64, rest: &str) -> Scene {
    Scene::from_text(&format!(
        "{{ geometry: {{ thickness: 1 mm, prestretch: 3, {geometry}{body} }}] }}, material: {{ model: neo-hookean, \
         shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ voltage: {volts} V }}{rest} }}"
    ))
    .unwrap()
}

fn solved(scene: &Scene, mesh: Mesh, pattern: &Pattern) -> Inflated {
    let found = InflationSolver::new(scene, SolveOptions::on(mesh))
        .unwrap()
        .solve(pattern);
    assert_eq!(found.outcome, InflationOutcome::Converged);
    found
}

fn pulled(newtons: f64) -> String {
    format!(", load: [0 N, 0 N, {newtons} N]")
}

fn active() -> Pattern {
    Pattern::from_fn(Raster::PAPER, |_, _| true)
}

/// The height of the hub of the disc, all active.
fn height(mesh: Mesh, volts: f64, body: &str) -> f64 {
    let found = solved(&scene_of(DISC, body, volts, ""), mesh, &active());
    found.bodies[0].translation[2]
}

const CONES: [(f64, f64, f64); 4] = [
    (0.0, 0.2, 1.1399898126),
    (0.0, 0.5, 2.8497539306),
    (5e3, 0.2, 1.4402620675),
    (5e3, 0.5, 3.6034904996),
];

#[test]
fn a_hub_that_is_pulled_out_of_a_disc_has_the_axisymmetric_height() {
    for (volts, newtons, known) in CONES {
        let found = solved(
            &scene_of(DISC, &pulled(newtons), volts, ""),
            Mesh::biquadratic(1),
            &active(),
        );
        let [x, y, height] = found.bodies[0].translation;
        assert!(
            (height - known).abs() < 3e-6 * known,
            "{volts} {newtons}: {height} {known}"
        );
        assert!(x.abs() < 1e-8 && y.abs() < 1e-8 && found.bodies[0].rotation.abs() < 1e-6);
        assert_eq!(found.pressure, 0.0);
        // A cone has a volume below it, the hub included.
        let least = 1e-3 * PI * 25.0 * height;
        assert!(found.volume > least, "{} {least}", found.volume);
        let below = solved(
            &scene_of(DISC, &pulled(-newtons), volts, ""),
            Mesh::biquadratic(1),
            &active(),
        );
        assert!((below.bodies[0].translation[2] + height).abs() < 1e-8);
    }
}

#[test]
fn heights_of_hubs_converge_with_the_mesh() {
    let (volts, newtons, known) = CONES[3];
    let error = |mesh| (height(mesh, volts, &pulled(newtons)) - known).abs();
    let [coarse, fine] = [1, 2].map(|count| error(Mesh::bilinear(count)));
    assert!(fine < 0.4 * coarse, "{coarse:e} {fine:e}");
    let [coarse, fine] = [1, 2].map(|count| error(Mesh::biquadratic(count)));
    assert!(fine < 0.4 * coarse && fine < 5e-7 * known, "{coarse:e} {fine:e}");
}

#[test]
fn a_spring_pulls_as_the_force_that_it_has_at_its_height() {
    let mesh = Mesh::biquadratic(1);
    let sprung = height(mesh, 5e3, ", load: [0 N, 0 N, 0.5 N], spring: [0 N/m, 0 N/m, 40 N/m]");
    let force = 0.5 - 40e-3 * sprung;
    assert!(
        force > 0.1 && (height(mesh, 5e3, &pulled(force)) - sprung).abs() < 1e-6,
        "{sprung}"
    );
    // One rate is that of all directions, and the hub does not move in the plane.
    let in_all = height(mesh, 5e3, ", load: [0 N, 0 N, 0.5 N], spring: 40 N/m, tilt: false");
    assert!((in_all - sprung).abs() < 1e-7);
}

#[test]
fn a_square_hub_has_the_known_translation_and_keeps_mirror_symmetry() {
    let mesh = Mesh::bilinear(1);
    // Bodies are bare.
    let found = solved(&scene_of(SQUARE, &pulled(0.2), 5250.0, ""), mesh, &half());
    let [x, y, height] = found.bodies[0].translation;
    assert!((x - 1.59534).abs() < 1e-5 && y.abs() < 1e-9, "{x} {y}");
    assert!((height - 1.22249).abs() < 1e-5, "{height}");
    assert!(found.bodies[0].rotation.abs() < 1e-7);
    let (field, at) = (&found.displacement, |x: usize, y: usize| found.heights[y * 51 + x]);
    for (x, y) in (0..51).flat_map(|y| (0..26).map(move |x| (2 * x, y))) {
        let ([a, b], [c, d]) = (field.at_corner(x, y), field.at_corner(x, 50 - y));
        assert!((a - c).abs() < 1e-8 && (b + d).abs() < 1e-8 && (at(x, y) - at(x, 50 - y)).abs() < 1e-8);
    }
    // All corners of the hub move as it does.
    assert!((at(20, 20) - height).abs() < 1e-12 && (at(25, 30) - height).abs() < 1e-12);
    let bare = Pattern::from_fn(Raster::PAPER, |_, _| false);
    let found = solved(&scene_of(SQUARE, &pulled(0.5), 0.0, ""), mesh, &bare);
    assert!((found.bodies[0].translation[2] - 2.681905).abs() < 1e-6);
}

#[test]
fn a_pressure_pushes_on_a_hub_as_on_the_membrane_in_its_place() {
    // A little: p (R² − r²)/(4 μH (1 − λ⁻⁶)).
    let pressure = ", loads: { pressure: 10 Pa }";
    let found = solved(&scene_of(DISC, "", 0.0, pressure), Mesh::biquadratic(1), &active());
    let exact = 1e3 * 10.0 * (25e-3_f64.powi(2) - 5e-3_f64.powi(2)) / (4.0 * 45.0 * (1.0 - 3.0_f64.powi(-6)));
    let height = found.bodies[0].translation[2];
    assert!((height - exact).abs() < 3e-4 * exact, "{height} {exact}");
    // The same state by its volume, with a load on the hub in addition.
    let rest = ", loads: { pressure: 500 Pa }";
    let scene = |rest| scene_of(DISC, &pulled(0.1), 4e3, rest);
    let by_pressure = solved(&scene(rest), Mesh::biquadratic(1), &active());
    let rest = format!(", loads: {{ volume: {} ml }}", by_pressure.volume);
    let by_volume = solved(&scene(&rest), Mesh::biquadratic(1), &active());
    assert!((by_volume.pressure - 500.0).abs() < 1e-3, "{}", by_volume.pressure);
    let [a, b] = [&by_pressure, &by_volume].map(|found| found.bodies[0].translation[2]);
    assert!(a > 2.0 && (a - b).abs() < 1e-6, "{a} {b}");
    // Above a closed chamber whose volume stays 0 the fluid holds the hub back.
    let closed = solved(&scene(", loads: { volume: 0 ml }"), Mesh::biquadratic(1), &active());
    let height = closed.bodies[0].translation[2];
    assert!(closed.volume.abs() < 1e-9 && closed.pressure < -10.0, "{closed:?}");
    assert!(
        height > 0.05 && height < 0.6 * solved(&scene(""), Mesh::biquadratic(1), &active()).bodies[0].translation[2]
    );
}

#[test]
fn a_body_without_forces_out_of_the_plane_moves_as_in_the_plane() {
    let at = ", bodies: [{ polygon: [[10 mm, 18 mm], [30 mm, 18 mm], [30 mm, 24 mm], [16 mm, 24 mm], [16 mm, 36 mm], \
              [10 mm, 36 mm]]";
    let geometry = format!("side: 50 mm, cells: 50{at}");
    let planar = scene_of(&geometry, ", load: [40 mN, -20 mN], spring: [10 N/m, 3 N/m]", 4e3, "");
    let solver = MembraneSolver::new(&planar, SolveOptions::on(Mesh::bilinear(1))).unwrap();
    let flat = solver.solve(&half());
    let motion = solver.grid().motions(&flat.displacement).unwrap()[0];
    assert!(motion.rotation.abs() > 0.1, "{}", motion.rotation);
    let with = |newtons: f64| {
        let body = format!(", load: [40 mN, -20 mN, {newtons} N], spring: [10 N/m, 3 N/m, 0 N/m]");
        solved(&scene_of(&geometry, &body, 4e3, ""), Mesh::bilinear(1), &half())
    };
    let still = with(0.0).bodies[0];
    assert!((0..2).all(|c| (still.translation[c] - motion.translation[c]).abs() < 1e-9));
    assert!(still.translation[2] == 0.0 && (still.rotation - motion.rotation).abs() < 1e-8);
    // Pulled up and down.
    let [up, down] = [0.3, -0.3].map(|newtons| with(newtons).bodies[0]);
    assert!(up.translation[2] > 1.0 && (up.translation[2] + down.translation[2]).abs() < 1e-7);
    assert!((0..2).all(|c| (up.translation[c] - down.translation[c]).abs() < 1e-7));
    assert!((up.rotation - down.rotation).abs() < 1e-6 && (up.rotation - still.rotation).abs() > 1e-5);
}

#[test]
fn springs_of_two_rates_act_along_their_axes() {
    let scene = |body: &str| scene_of(SQUARE, body, 4e3, "");
    let pattern = random_on(Raster::PAPER, 5);
    let pose = |body: &str, pattern: &Pattern| {
        let scene = scene(body);
        let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(1))).unwrap();
        let motion = solver.grid().motions(&solver.solve(pattern).displacement).unwrap()[0];
        (motion.translation, scene)
    };
    let (free, _) = pose(", load: [60 mN, 50 mN], spring: 5 N/m", &pattern);
    let (equal, _) = pose(", load: [60 mN, 50 mN], spring: [5 N/m, 5 N/m]", &pattern);
    assert_eq!(free, equal);
    let (moved, one) = pose(", load: [60 mN, 50 mN], spring: [20 N/m, 5 N/m]", &pattern);
    let forces = [60.0 - 20.0 * moved[0], 50.0 - 5.0 * moved[1]];
    let (by_forces, _) = pose(&format!(", load: [{} mN, {} mN]", forces[0], forces[1]), &pattern);
    assert!(
        (0..2).all(|c| (by_forces[c] - moved[c]).abs() < 1e-6),
        "{by_forces:?} {moved:?}"
    );
    // With columns and rows exchanged.
    let transpose = Symmetry::ALL
        .into_iter()
        .find(|g| g.matrix() == [[0, 1], [1, 0]])
        .unwrap();
    let body = ", load: [50 mN, 60 mN], spring: [5 N/m, 20 N/m]";
    let (transposed, _) = pose(body, &pattern.transformed(transpose));
    assert!((0..2).all(|c| (transposed[c] - moved[1 - c]).abs() < 1e-9));
    // They are no symmetry of the device.
    assert!(!one.symmetries().contains(transpose));
    assert!(scene(", spring: 20 N/m").symmetries().contains(transpose));
    assert!(scene(", spring: [20 N/m, 5 N/m]").symmetries().count() == 4);
}
