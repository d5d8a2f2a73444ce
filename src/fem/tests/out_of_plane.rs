//! Small motions out of the plane. Known answers are those of an independent program.

use super::scenes::{PointWork, combinations, with_law};
use super::*;
use crate::kinematics::{Tensor, add_scaled, cofactor, determinant, times_transposed, transposed};
use deaflow_pattern::Coverage;

fn scene_at(prestretch: f64, volts: f64) -> Scene {
    Scene::from_text(&format!(
        "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: {prestretch}, cells: 50 }}, material: {{ model: \
         neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, properties: {{ density: 960 }}, drive: {{ \
         voltage: {volts} V }} }}"
    ))
    .unwrap()
}

fn transverse(scene: &Scene, pattern: &Pattern, mesh: Mesh, count: usize) -> Transverse {
    let solver = MembraneSolver::new(scene, SolveOptions::on(mesh)).unwrap();
    solver.vibration(pattern, count, false).unwrap().out_of_plane
}

fn active(is_active: bool) -> Pattern {
    Pattern::from_fn(Raster::PAPER, |_, _| is_active)
}

#[test]
fn frequencies_out_of_the_plane_are_the_known_ones() {
    let (rest, driven) = (scene_at(3.0, 0.0), scene_at(3.0, 5250.0));
    let (fine, coarse) = (Mesh::biquadratic(1), Mesh::bilinear(1));
    let cases: [(&Scene, Pattern, Mesh, &[f64]); 6] = [
        (&rest, active(false), fine, &[290.274458, 458.964277, 458.964277]),
        (&rest, active(false), coarse, &[290.322206]),
        (&driven, half(), fine, &[270.722605, 422.886024, 427.072929]),
        (&driven, half(), coarse, &[270.772995]),
        (&driven, active(true), fine, &[254.761764]),
        (&driven, active(true), coarse, &[254.803670]),
    ];
    for (scene, pattern, mesh, known) in cases {
        let found = transverse(scene, &pattern, mesh, known.len());
        assert_eq!((found.frequencies.len(), found.unstable), (known.len(), 0));
        for (hertz, known) in found.frequencies.iter().zip(known) {
            assert!((hertz / known - 1.0).abs() < 3e-9, "{hertz} {known}");
        }
        for heights in &found.modes {
            assert_eq!(heights.len(), 51 * 51);
            let largest = heights.iter().copied().fold(0.0, f64::max);
            assert!((largest - 1.0).abs() < 1e-12, "{largest}");
        }
    }
}

/// f = (λ/2L) √(μ(1 − λ⁻⁶ − κλ²)/ρ) √(m² + n²) of a uniform membrane.
#[test]
fn a_uniform_membrane_has_the_closed_form_and_buckles_where_its_tension_ends() {
    let closed = |scene: &Scene, lambda: f64, both: f64| {
        let tension = 1.0 - lambda.powi(-6) - scene.kappa() * lambda * lambda;
        10.0 * lambda * (45e3 * tension / 960.0 * both).sqrt()
    };
    let slack = |lambda: f64| {
        let kappa = scene_at(lambda, 1000.0).kappa();
        1000.0 * ((1.0 - lambda.powi(-6)) / (kappa * lambda * lambda)).sqrt()
    };
    for (lambda, share) in [(1.2, 0.0), (1.2, 0.9), (1.2, 0.999), (2.0, 0.7), (3.0, 0.5)] {
        let scene = scene_at(lambda, share * slack(lambda));
        let found = transverse(&scene, &active(true), Mesh::biquadratic(1), 4);
        let known = [2.0, 5.0, 5.0, 8.0].map(|both| closed(&scene, lambda, both));
        for (hertz, known) in found.frequencies.iter().zip(known) {
            assert!((hertz / known - 1.0).abs() < 1e-6, "{lambda} {share}: {hertz} {known}");
        }
        assert_eq!(found.unstable, 0);
    }
    // Without prestretch a voltage compresses it: all motions out of the plane are unstable at once, as soon as the
    // compression counts.
    for (volts, unstable) in [(0.0, 0), (500.0, 0), (4000.0, 49 * 49)] {
        let found = transverse(&scene_at(1.0, volts), &active(true), Mesh::bilinear(1), 3);
        assert_eq!((found.unstable, found.frequencies), (unstable, vec![0.0; 3]), "{volts}");
    }
}

/// Free edges of a strip in tension are compressed a little, by the more motions the finer the mesh; they are left out.
#[test]
fn edges_that_are_compressed_a_little_do_not_hide_frequencies() {
    let strip = |load: f64, [nx, ny]: [usize; 2], count: usize| {
        let scene = Scene::from_text(&format!(
            "{{ geometry: {{ size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 2, cells: [{nx}, {ny}], sides: {{ \
             right: {{ bar: {{ load: [{load} N, 0 N], mass: 30 g }} }}, top: free, bottom: free }} }}, material: {{ \
             model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, properties: {{ density: 960 }}, \
             drive: {{ voltage: 0 V }} }}"
        ))
        .unwrap();
        let bare = Pattern::from_fn(scene.membrane().raster, |_, _| false);
        transverse(&scene, &bare, Mesh::biquadratic(2), count)
    };
    // In the corners of the held side two short motions are unstable on a finer mesh; they come first.
    for (cells, unstable) in [([12, 8], 0), ([24, 16], 2)] {
        let known = strip(0.3, cells, 8);
        assert_eq!(known.unstable, unstable);
        assert!(known.frequencies[..unstable].iter().all(|hertz| *hertz == 0.0));
        assert!(known.frequencies[unstable] > 100.0 && known.frequencies.is_sorted());
        for count in 1..=4 {
            let found = strip(0.3, cells, count);
            assert_eq!((found.unstable, found.frequencies.len()), (known.unstable, count));
            for (hertz, known) in found.frequencies.iter().zip(&known.frequencies) {
                assert!(
                    (hertz - known).abs() <= 1e-9 * known,
                    "{cells:?} {count}: {hertz} {known}"
                );
            }
        }
    }
    // Pushed, the strip buckles as a whole, and its first frequencies are those motions.
    let found = strip(-0.05, [12, 8], 4);
    assert!(found.unstable > 0 && found.frequencies[0] == 0.0);
    assert!(found.frequencies.iter().take(found.unstable).all(|hertz| *hertz == 0.0));
}

#[test]
fn small_meshes_have_all_their_modes_and_no_more() {
    let text = "{ geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 3 }, material: { model: \
                neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }, properties: { density: 960 }, drive: \
                { voltage: 1 kV } }";
    let scene = Scene::from_text(text).unwrap();
    let corner = Pattern::from_fn(scene.membrane().raster, |x, y| x == 0 && y == 0);
    for (mesh, unknowns) in [(Mesh::bilinear(1), 4), (Mesh::biquadratic(1), 25)] {
        let found = transverse(&scene, &corner, mesh, 100);
        assert_eq!(found.frequencies.len(), unknowns);
        assert!(found.frequencies.is_sorted());
    }
}

/// The energy of a deformation with a slope out of the plane is that of the deformation √C in the plane.
struct SecondVariation;

impl PointWork for SecondVariation {
    type Output = f64;

    fn run<L: Material>(self, material: &L) -> f64 {
        let f: Tensor<f64> = [[1.05, 0.03], [-0.02, 0.93]];
        let gradient = [[f[0][0] - 1.0, f[0][1]], [f[1][0], f[1][1] - 1.0]];
        let stress = add_scaled(material.stress(gradient, 1.0), 1.0, material.self_stress(f));
        let inverse = transposed(cofactor(f)).map(|row| row.map(|value| value / determinant(f)));
        let second = times_transposed(inverse, transposed(stress));
        let slope = [0.3, -0.8];
        let known: f64 = (0..2)
            .flat_map(|i| (0..2).map(move |k| (i, k)))
            .map(|(i, k)| slope[i] * second[i][k] * slope[k])
            .sum();
        let energy = |size: f64| {
            let [x, y] = slope.map(|part| size * part);
            let squares = times_transposed(transposed(f), transposed(f));
            let c = add_scaled(squares, 1.0, [[x * x, x * y], [x * y, y * y]]);
            // √C = (C + √det C I)/√(tr C + 2 √det C).
            let root = determinant(c).sqrt();
            let sum = add_scaled(c, root, [[1.0, 0.0], [0.0, 1.0]]);
            let trace = (c[0][0] + c[1][1] + 2.0 * root).sqrt();
            material.energy(sum.map(|row| row.map(|value| value / trace)), 1.0)
        };
        let step = 1e-3;
        let change = |step: f64| 2.0 * (energy(step) - energy(0.0)) / (step * step);
        // The error is of second order in the step.
        let found = (4.0 * change(step) - change(2.0 * step)) / 3.0;
        (found - known).abs() / known.abs()
    }
}

#[test]
fn the_stiffness_is_the_second_variation_of_the_energy_of_all_laws() {
    for effects in combinations() {
        let error = with_law(&super::scenes::scene(2.5, 4000.0, effects.clone()), SecondVariation);
        assert!(error < 1e-7, "{effects:?}: {error:e}");
    }
}

#[test]
fn cells_that_are_covered_in_part_vibrate_like_the_shapes_that_they_stand_for() {
    // An edge through the middle of cells, at 23.5 mm.
    let scene = scene_at(3.0, 5250.0);
    let shares: Vec<f64> = (0..2500)
        .map(|at| [1.0, 0.5, 0.0][(at % 50).clamp(22, 24) - 22])
        .collect();
    let groups: Vec<u8> = shares.iter().map(|share| u8::from(*share > 0.0)).collect();
    let covered = Pattern::of_coverage(Coverage::new(Raster::PAPER, &groups, &shares).unwrap());
    let fine = Scene::from_text(&scene.to_yaml().replace("cells: 50", "cells: 100")).unwrap();
    let drawn = Pattern::from_fn(fine.membrane().raster, |x, _| x < 47);
    let of_shares = transverse(&scene, &covered, Mesh::biquadratic(1), 3).frequencies;
    let of_cells = transverse(&fine, &drawn, Mesh::biquadratic(1), 3).frequencies;
    for (share, cell) in of_shares.iter().zip(&of_cells) {
        assert!((share / cell - 1.0).abs() < 5e-5, "{of_shares:?} {of_cells:?}");
    }
}
