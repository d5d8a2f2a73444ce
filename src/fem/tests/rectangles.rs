//! Membranes other than the square of the source paper: other sides, other cells, unequal prestretch.

use super::*;
use deaflow_base::{Decimal, Length};
use deaflow_scene::{Both, Geometry};

/// A scene of VHB 4910, 1 mm thick.
fn scene(sides: [usize; 2], size: [f64; 2], prestretch: [f64; 2], voltage: f64) -> Scene {
    let base = Scene::vhb4910().at_voltage(voltage);
    let size = size.map(|side| Length::from_f64(side).unwrap());
    Scene {
        geometry: Geometry {
            side: None,
            size: Some(size),
            prestretch: Both(prestretch.map(|stretch| Decimal::from_f64(stretch).unwrap())),
            cells: Both(sides),
            ..base.geometry.clone()
        }
        .normalised(),
        ..base
    }
}

fn simulate(scene: &Scene, mesh: Mesh, pattern: &Pattern) -> Field {
    let options = SolveOptions { mesh, tolerance: 1e-10 };
    let solver = MembraneSolver::new(scene, options).unwrap();
    let result = solver.simulate(std::slice::from_ref(pattern)).remove(0);
    assert_eq!(result.outcome, Outcome::Converged);
    result.field.unwrap()
}

/// The half-active strip: its displacement is prescribed on the frame and must be found inside.
#[test]
fn the_strip_has_the_closed_form_displacement_and_stress() {
    // a − a⁻³λ₂⁻² − κλ₂²a = b − b⁻³λ₂⁻² with a = λ₁(1 + e), b = λ₁(1 − e), by mpmath: (kV, u in the middle in mm, P₁₁
    // in Pa) at 45 kPa and 1 mm.
    let rows = [
        ([3.0, 4.0], 1.0, 0.185899056254, 133889.6197),
        ([3.0, 4.0], 3.0, 1.77884081994, 125264.273415),
        ([3.0, 4.0], 5.0, 5.65400307582, 104243.594186),
        ([4.0, 3.0], 2.0, 0.42263106486, 176874.831332),
        ([4.0, 3.0], 4.0, 1.78080085867, 167080.719509),
        ([2.0, 5.0], 1.0, 0.290167849987, 88722.3757614),
        ([2.0, 5.0], 4.0, 5.6118044576, 69315.122756),
    ];
    for (prestretch, kilovolts, middle, stress) in rows {
        for (sides, size, mesh) in [
            ([50, 50], [50.0, 50.0], Mesh::bilinear(1)),
            ([30, 11], [50.0, 17.0], Mesh::bilinear(2)),
            ([16, 9], [50.0, 70.0], Mesh::biquadratic(1)),
        ] {
            let scene = scene(sides, size, prestretch, 1e3 * kilovolts);
            let raster = scene.membrane().raster;
            let pattern = Pattern::from_fn(raster, |x, _| 2 * x < raster.columns());
            let grid = Grid::uniform(mesh, &Sheet::of(&scene));
            let (layout, [columns, rows]) = (grid.layout(), grid.layout().nodes());
            let material = AnyMaterial::from(NeoHookean::new(scene.mean_prestretch(), scene.kappa()));
            let activity = Activity::new(&grid, &pattern);
            let operator = Operator::new(&material, &activity);
            let mut u = vec![0.0; layout.vector_len()];
            for (row, column) in places(&grid) {
                let inside = (1..columns - 1).contains(&column) && (1..rows - 1).contains(&row);
                let share = column.min(columns - 1 - column) as f64 / ((columns - 1) / 2) as f64;
                let wave = if inside {
                    0.02 * ((row * 7 + column * 3) as f64).sin()
                } else {
                    0.0
                };
                u[layout.index(0, column, row)] = middle / grid.unit_mm() * share + wave;
            }
            newton_by_factors(&operator, &vec![0.0; layout.vector_len()], &mut u);
            let node = layout.index(0, (columns - 1) / 2, rows / 2);
            let found = grid.unit_mm() * u[node];
            assert!(
                (found / middle - 1.0).abs() < 1e-9,
                "{prestretch:?}, {kilovolts} kV: {found} {middle}"
            );
            for cell in cell_states(&scene, mesh, &pattern, &u).unwrap() {
                assert!((cell.piola[0][0] / stress - 1.0).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn a_membrane_that_is_active_everywhere_is_lost_at_the_closed_form_voltage() {
    // εE² = μ(λm² + 3J⁻²) with the smaller stretch λm; for unequal prestretch the mode has short waves, and 25
    // biquadratic elements along a side give 0.02 % and 0.08 % more.
    for (prestretch, exact, above) in [
        ([3.0, 3.0], 10983.8219587, 1e-4),
        ([3.0, 4.0], 8230.47777316, 5e-4),
        ([4.0, 3.0], 8230.47777316, 5e-4),
        ([2.0, 5.0], 6601.39144533, 2e-3),
    ] {
        let scene = scene([25, 25], [50.0, 50.0], prestretch, 1.05 * exact);
        let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::biquadratic(1))).unwrap();
        let all = Pattern::from_fn(scene.membrane().raster, |_, _| true);
        let [stable, unstable] = solver.solve(&all).outcome.bracket().unwrap();
        assert!(
            unstable > exact && stable < exact * (1.0 + above),
            "{prestretch:?}: {stable} {unstable} {exact}"
        );
        // Below it, nothing moves.
        let field = simulate(&scene.at_voltage(0.9 * exact), Mesh::bilinear(1), &all);
        assert_eq!(field.max_magnitude(), 0.0);
    }
}

#[test]
fn transposed_and_mirrored_devices_have_transposed_and_mirrored_fields() {
    let wide = scene([22, 13], [60.0, 30.0], [3.0, 4.0], 4e3);
    let high = scene([13, 22], [30.0, 60.0], [4.0, 3.0], 4e3);
    let pattern = random_on(wide.membrane().raster, 3);
    for mesh in [Mesh::bilinear(1), Mesh::bilinear(2), Mesh::biquadratic(1)] {
        let field = simulate(&wide, mesh, &pattern);
        assert!(field.max_magnitude() > 0.1);
        for g in Symmetry::ALL {
            let device = if g.exchanges_axes() { &high } else { &wide };
            let image = simulate(device, mesh, &pattern.transformed(g));
            assert!(image.rms_difference(&field.transformed(g)) < 1e-9);
        }
    }
}

#[test]
fn cells_that_are_not_square_describe_the_same_membrane() {
    // The same electrode on cells of half the width: only the elements differ.
    let coarse = scene([20, 20], [60.0, 30.0], [3.0, 3.5], 4e3);
    let fine = scene([40, 20], [60.0, 30.0], [3.0, 3.5], 4e3);
    let pattern = random_on(coarse.membrane().raster, 5);
    let split = Pattern::from_fn(fine.membrane().raster, |x, y| pattern.is_active(x / 2, y));
    let (a, b) = (
        simulate(&coarse, Mesh::biquadratic(2), &pattern),
        simulate(&fine, Mesh::biquadratic(2), &split),
    );
    for (x, y) in [(5, 5), (10, 10), (13, 4), (19, 12)] {
        let (a, b) = (a.at_corner(x, y), b.at_corner(2 * x, y));
        let gap = (a[0] - b[0]).hypot(a[1] - b[1]);
        assert!(gap < 6e-3 * a[0].hypot(a[1]).max(0.1), "{gap}: {a:?} {b:?}");
    }
}

#[test]
fn the_gradient_of_a_displacement_agrees_with_differences() {
    let scene = scene([12, 9], [60.0, 20.0], [3.0, 4.0], 4e3);
    let raster = scene.membrane().raster;
    let pattern = random_on(raster, 8);
    let mut weights = vec![0.0; 2 * raster.corners()];
    weights[2 * (4 * 13 + 7)] = 1.0;
    weights[2 * (2 * 13 + 3) + 1] = -0.5;
    let weights = Field::from_values(raster, weights).unwrap();
    for mesh in [Mesh::bilinear(2), Mesh::biquadratic(1)] {
        let options = SolveOptions { mesh, tolerance: 1e-12 };
        let solver = MembraneSolver::new(&scene, options).unwrap();
        check_gradient(&scene, &solver, &pattern, &weights, [0, 17, 55, 80, 107].into_iter());
    }
}

#[test]
fn small_voltages_do_not_drown_in_the_rounding_of_the_prestress() {
    // Displacements grow with the square of the voltage.
    let at = |voltage| {
        let scene = scene([24, 16], [60.0, 30.0], [3.0, 4.0], voltage);
        let pattern = random_on(scene.membrane().raster, 2);
        simulate(&scene, Mesh::bilinear(1), &pattern)
    };
    let (one, hundred) = (at(1.0), at(100.0));
    let largest = hundred.max_magnitude();
    assert!(largest > 1e-5);
    for (a, b) in one.values().iter().zip(hundred.values()) {
        assert!((1e4 * a - b).abs() < 1e-4 * largest, "{a:e} {b:e}");
    }
}

#[test]
fn hard_rasters_are_solved() {
    for (sides, size, prestretch) in [
        ([1, 400], [2.0, 100.0], [3.0, 3.0]),
        ([400, 1], [100.0, 2.0], [2.0, 4.0]),
        ([3, 3], [50.0, 50.0], [3.0, 3.0]),
        ([1, 1], [10.0, 20.0], [3.0, 2.0]),
        ([31, 8], [50.0, 10.0], [1.0, 3.0]),
        ([5, 160], [400.0, 10.0], [6.0, 1.0]),
    ] {
        let scene = scene(sides, size, prestretch, 1e3);
        let raster = scene.membrane().raster;
        let pattern = Pattern::from_fn(raster, |x, y| (x + y / 3) % 2 == 0);
        let mut largest = Vec::new();
        for mesh in [
            Mesh::bilinear(1),
            Mesh::bilinear(2),
            Mesh::biquadratic(1),
            Mesh::bilinear(3),
        ] {
            let solver = MembraneSolver::new(&scene, SolveOptions::on(mesh)).unwrap();
            let result = solver.simulate(std::slice::from_ref(&pattern)).remove(0);
            assert_eq!(result.outcome, Outcome::Converged, "{sides:?} {mesh}");
            let states = solver.cell_states(&pattern, &solver.solve(&pattern));
            assert!(states.len() == raster.cells() && states.iter().all(|state| state.stretches[1] > 0.0));
            largest.push(result.field.unwrap().max_magnitude());
        }
        // With one cell across, the corners of cells are on the frame.
        let moves = sides.iter().all(|&side| side > 1);
        assert_eq!(largest.iter().all(|&mm| mm > 0.0), moves, "{sides:?}: {largest:?}");
    }
}
