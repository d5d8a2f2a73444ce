//! Membranes whose motions as a whole nothing resists.

use super::sides::{cells_in, scene, solved, solver_of};
use super::*;
use crate::precondition::Laplacian;

/// A sheet with these sides.
fn sheet(size: [f64; 2], prestretch: [f64; 2], cells: [usize; 2], sides: &str, voltage: f64) -> Scene {
    let ([x, y], [a, b], [columns, rows]) = (size, prestretch, cells);
    scene(
        &format!("size: [{x} mm, {y} mm], prestretch: [{a}, {b}], cells: [{columns}, {rows}], sides: {{ {sides} }}"),
        voltage,
    )
}

const ALL_FREE: &str = "left: free, right: free, bottom: free, top: free";
/// An electrode without symmetry.
fn odd(scene: &Scene) -> Pattern {
    let [x, y] = scene.membrane().size_mm;
    cells_in(scene, [0.2 * x, 0.8 * x], [0.0, 0.5 * y])
}

fn field_of(scene: &Scene, pattern: &Pattern) -> Field {
    solved(scene, Mesh::biquadratic(1), pattern).0.field.unwrap()
}

/// The distances of the deformed corners of cells from each other, each from one ten further.
fn distances(scene: &Scene, field: &Field) -> Vec<f64> {
    let membrane = scene.membrane();
    let ([columns, rows], cell) = (membrane.raster.corner_sides(), membrane.cell_mm());
    let corner = |at: usize| {
        let (x, y) = (at % columns, at / columns);
        let [p, q] = field.at_corner(x, y);
        [cell[0] * x as f64 + p, cell[1] * y as f64 + q]
    };
    let all = columns * rows;
    let apart = |at: usize| {
        let ([a, b], [x, y]) = (corner(at), corner((7 * at + 10) % all));
        (a - x).hypot(b - y)
    };
    (0..all).map(apart).collect()
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn a_free_sheet_that_is_active_everywhere_has_the_closed_form() {
    for (prestretch, volts) in [
        (1.0, 0.0),
        (1.0, 9000.0),
        (1.7, 0.0),
        (3.0, 0.0),
        (3.0, 3000.0),
        (4.0, 15e3),
    ] {
        for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
            let scene = sheet([30.0, 20.0], [prestretch; 2], [6, 4], ALL_FREE, volts);
            let pattern = Pattern::from_fn(scene.membrane().raster, |_, _| true);
            let field = solved(&scene, mesh, &pattern).0.field.unwrap();
            let ([a, b], [x, y]) = (field.at_corner(0, 0), field.at_corner(6, 4));
            let stretches = [prestretch * (1.0 + (x - a) / 30.0), prestretch * (1.0 + (y - b) / 20.0)];
            let kappa = 4.7 * 8.854_187_812_8e-12 * (volts / 1e-3).powi(2) / 45e3;
            for l in stretches {
                let off = l.powi(2) - l.powi(-4) - kappa * l.powi(4);
                assert!(off.abs() < 1e-8, "{prestretch} {volts}: {l} {off:e}");
            }
            // The middle stays.
            assert!((x + a).abs() < 1e-9 && (y + b).abs() < 1e-9, "{a} {b} {x} {y}");
        }
    }
}

#[test]
fn a_free_sheet_with_symmetries_is_a_quarter_on_rollers() {
    let whole = sheet([30.0, 20.0], [3.0, 2.0], [12, 8], ALL_FREE, 5000.0);
    let rollers = "left: roller, bottom: roller, right: free, top: free";
    let quarter = sheet([15.0, 10.0], [3.0, 2.0], [6, 4], rollers, 5000.0);
    let is_active = |x: usize, y: usize| x < 3 && y < 3 || x == 4 && y == 0;
    let of_quarter = Pattern::from_fn(quarter.membrane().raster, is_active);
    let mirrored = |at: usize, count: usize| if at < count { count - 1 - at } else { at - count };
    let of_whole = Pattern::from_fn(whole.membrane().raster, |x, y| {
        is_active(mirrored(x, 6), mirrored(y, 4))
    });
    let (solver, other) = (
        solver_of(&whole, Mesh::biquadratic(1)),
        solver_of(&quarter, Mesh::biquadratic(1)),
    );
    let (found, known) = (solver.solve(&of_whole), other.solve(&of_quarter));
    println!(
        "free: {} Newton, {} CG; on rollers: {} Newton, {} CG",
        found.newton_iterations, found.krylov_iterations, known.newton_iterations, known.krylov_iterations
    );
    assert!(found.krylov_iterations < 2 * known.krylov_iterations + 20);
    let (field, of_quarter) = (solver.field(&found), other.field(&known));
    for (x, y) in (0..=6).flat_map(|x| (0..=4).map(move |y| (x, y))) {
        let ([a, b], [p, q]) = (field.at_corner(6 + x, 4 + y), of_quarter.at_corner(x, y));
        assert!((a - p).abs() < 1e-8 && (b - q).abs() < 1e-8, "{x} {y}: {a} {p} {b} {q}");
        let [c, d] = field.at_corner(6 - x, 4 - y);
        assert!((a + c).abs() < 1e-8 && (b + d).abs() < 1e-8);
    }
}

#[test]
fn images_of_patterns_on_free_sheets_have_the_images_of_displacements() {
    let scene = sheet([20.0, 20.0], [3.0, 3.0], [8, 8], ALL_FREE, 5000.0);
    let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| (x + 2 * y) % 7 < 3 && x < 6);
    let field = field_of(&scene, &pattern);
    for g in Symmetry::ALL {
        let image = field_of(&scene, &pattern.transformed(g));
        let off = image.max_difference(&field.transformed(g));
        assert!(off < 1e-8, "{g:?}: {off:e}");
    }
}

#[test]
fn opposite_loads_are_one_load_against_a_roller() {
    for (left, right) in [
        ("{ load: [-0.3 N, 0 N] }", "{ load: [0.3 N, 0 N] }"),
        ("{ bar: { load: [-0.3 N, 0 N] } }", "{ bar: { load: [0.3 N, 0 N] } }"),
    ] {
        for prestretch in [[1.0, 1.0], [2.5, 1.5]] {
            let sides = format!("left: {left}, right: {right}, top: free, bottom: free");
            let whole = sheet([40.0, 16.0], prestretch, [16, 6], &sides, 5000.0);
            let sides = format!("left: roller, right: {right}, top: free, bottom: free");
            let half = sheet([20.0, 16.0], prestretch, [8, 6], &sides, 5000.0);
            let is_active = |x: usize, y: usize| x < 5 && (1..4).contains(&y);
            let pattern = Pattern::from_fn(half.membrane().raster, is_active);
            let of_half = field_of(&half, &pattern);
            let mirrored = |at: usize| if at < 8 { 7 - at } else { at - 8 };
            let pattern = Pattern::from_fn(whole.membrane().raster, |x, y| is_active(mirrored(x), y));
            let field = field_of(&whole, &pattern);
            for (x, y) in (0..=8).flat_map(|x| (0..=6).map(move |y| (x, y))) {
                let ([a, b], [p, q]) = (field.at_corner(8 + x, y), of_half.at_corner(x, y));
                assert!(
                    (a - p).abs() < 1e-7 && (b - q).abs() < 1e-7,
                    "{right} {x} {y}: {a} {p} {b} {q}"
                );
            }
        }
    }
}

#[test]
fn opposite_loads_that_push_are_not_stable() {
    let sides = "left: { load: [0.02 N, 0 N] }, right: { load: [-0.02 N, 0 N] }, top: free, bottom: free";
    let scene = sheet([20.0, 10.0], [1.0, 1.0], [8, 4], sides, 100.0);
    let solution = solver_of(&scene, Mesh::biquadratic(1)).solve(&odd(&scene));
    assert!(
        matches!(solution.outcome, Outcome::PullIn { .. } | Outcome::IterationLimit),
        "{}",
        solution.outcome
    );
}

/// Shapes do not depend on what a sheet without loads turns about, if it turns.
#[test]
fn a_sheet_that_turns_has_the_shape_of_one_that_is_kept_from_it() {
    let on_bar = |bar: &str| format!("sides: {{ right: {{ bar: {{ {bar} }} }}, left: free, top: free, bottom: free }}");
    let with_body = |more: &str| {
        let shape = "rectangle: [[8 mm, 4 mm], [16 mm, 12 mm]]";
        format!("bodies: [ {{ {shape}{more} }} ], sides: {{ {ALL_FREE} }}")
    };
    let devices = [
        vec![
            on_bar("moves: []"),
            on_bar("moves: [x, y, turn]"),
            on_bar("moves: [turn]"),
            on_bar("moves: [y, turn]"),
            on_bar("moves: [x, turn]"),
            on_bar("spring: 5 N/m"),
            on_bar("displacement: [3 mm, 1 mm], moves: [turn]"),
        ],
        vec![with_body(""), with_body(", spring: 20 N/m")],
    ];
    for same in devices {
        let mut known: Option<Vec<f64>> = None;
        for supports in same {
            let geometry = format!("size: [24 mm, 16 mm], prestretch: [2, 2.5], cells: [12, 8], {supports}");
            let scene = scene(&geometry, 6000.0);
            assert_eq!(scene.geometry.floating().is_none(), supports.contains("moves: []"));
            let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| (x < 9 && y > 5) || (x > 9 && y < 3));
            let found = distances(&scene, &field_of(&scene, &pattern));
            let off = largest_difference(known.get_or_insert_with(|| found.clone()), &found);
            assert!(off < 1e-7, "{supports}: {off:e}");
        }
    }
}

#[test]
fn factors_of_floating_sheets_have_their_tangent_and_inertia() {
    for sides in [
        ALL_FREE.to_owned(),
        "left: roller, right: free, top: free, bottom: free".to_owned(),
        "left: { bar: {} }, right: free, top: free, bottom: free".to_owned(),
        "left: { bar: { load: [-0.2 N, 0 N] } }, right: { bar: { load: [0.2 N, 0 N] } }, top: free, bottom: free"
            .to_owned(),
        "left: { bar: { moves: [y, turn] } }, right: free, top: free, bottom: free".to_owned(),
    ] {
        for mesh in [Mesh::bilinear(2), Mesh::biquadratic(1)] {
            let scene = sheet([30.0, 20.0], [2.0, 1.5], [6, 4], &sides, 4000.0);
            let solver = solver_of(&scene, mesh);
            let grid = solver.grid();
            let activity = Activity::new(grid, &odd(&scene));
            let material = AnyMaterial::from(NeoHookean::of(0.3, 0.2));
            let operator = Operator::new(&material, &activity);
            let len = grid.layout().vector_len();
            let wave = |phase: f64| -> Vec<f64> { (0..len).map(|i| 0.02 * (i as f64 * 0.61 + phase).sin()).collect() };
            let mut u = wave(0.2);
            grid.restrict(&vec![0.0; len], &mut u);
            grid.settle(&mut u);
            let mut again = u.clone();
            grid.settle(&mut again);
            let off = largest_difference(&u, &again);
            assert!(off < 1e-14, "{sides}: {off:e}");
            let mut du = wave(1.3);
            grid.restrict(&u, &mut du);
            let mut again = du.clone();
            grid.restrict(&u, &mut again);
            assert!(largest_difference(&du, &again) < 1e-14);
            let mut product = vec![0.0; len];
            operator.tangent(&u, &du, &mut product);
            let factors = Factorisation::new(&operator, &u).unwrap();
            let off = largest_difference(&factors.solve(&product), &du);
            assert!(off < 1e-10, "{sides} {mesh}: {off:e}");
            // As many negative eigenvalues as the projected tangent has by a shift of a mode.
            let laplacian = Laplacian::new(grid).unwrap();
            let mut found = Vec::new();
            for pull in [0.2, 4.0] {
                let material = AnyMaterial::from(NeoHookean::of(0.3, pull));
                let operator = Operator::new(&material, &activity);
                let negative = Factorisation::new(&operator, &u).unwrap().negative_pivots();
                let smallest = crate::eigenvalue::smallest(&operator, &laplacian, &u, None)
                    .unwrap()
                    .value;
                assert_eq!(
                    negative == 0,
                    smallest > 0.0,
                    "{sides} {mesh} {pull}: {negative} {smallest}"
                );
                found.push(negative);
            }
            println!("{sides} {mesh}: {found:?}");
            assert!(found[1] > 0);
        }
    }
}

#[test]
fn tangents_of_floating_sheets_are_derivatives_of_residuals() {
    for sides in [
        ALL_FREE,
        "left: roller, right: { load: [0.1 N, 0 N] }, top: free, bottom: free",
    ] {
        let scene = sheet([30.0, 20.0], [2.0, 1.5], [6, 4], sides, 4000.0);
        let solver = solver_of(&scene, Mesh::biquadratic(1));
        let grid = solver.grid();
        let activity = Activity::new(grid, &odd(&scene));
        let material = AnyMaterial::from(NeoHookean::of(0.3, 0.2));
        let operator = Operator::new(&material, &activity);
        let len = grid.layout().vector_len();
        let wave = |phase: f64| -> Vec<f64> {
            let mut u: Vec<f64> = (0..len).map(|i| 0.02 * (i as f64 * 0.61 + phase).sin()).collect();
            grid.restrict(&vec![0.0; len], &mut u);
            u
        };
        let (u, du) = (wave(0.2), wave(1.3));
        let mut product = vec![0.0; len];
        operator.tangent(&u, &du, &mut product);
        let at = |step: f64| {
            let moved: Vec<f64> = u.iter().zip(&du).map(|(u, du)| u + step * du).collect();
            let mut residual = vec![0.0; len];
            operator.residual(&moved, &mut residual);
            residual
        };
        let (ahead, behind) = (at(1e-5), at(-1e-5));
        let difference: Vec<f64> = ahead.iter().zip(&behind).map(|(a, b)| (a - b) / 2e-5).collect();
        assert!(
            largest_difference(&difference, &product) < 1e-7 * norm(&product),
            "{sides}"
        );
    }
}

#[test]
fn gradients_of_floating_sheets_are_those_of_differences() {
    for sides in [
        ALL_FREE,
        "left: { bar: { load: [-0.2 N, 0 N], at: 3 mm } }, right: { bar: { load: [0.2 N, 0 N], at: 3 mm } }, top: \
         free, bottom: free",
        "left: { bar: {} }, right: free, top: free, bottom: free",
    ] {
        let scene = sheet([30.0, 20.0], [2.0, 1.5], [6, 4], sides, 4000.0);
        let solver = solver_of(&scene, Mesh::biquadratic(1));
        let raster = scene.membrane().raster;
        let mut weights = vec![0.0; 2 * raster.corners()];
        let corner = raster.columns();
        (weights[2 * corner], weights[2 * corner + 1], weights[20]) = (1.0, -0.5, 0.3);
        let weights = Field::from_values(raster, weights).unwrap();
        check_gradient(&scene, &solver, &odd(&scene), &weights, (0..raster.cells()).step_by(5));
    }
}

#[test]
fn a_path_of_a_free_sheet_has_the_known_fold() {
    let scene = sheet([10.0, 10.0], [1.0, 1.0], [2, 2], ALL_FREE, 20_000.0);
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-10,
    };
    let pattern = Pattern::from_fn(scene.membrane().raster, |_, _| true);
    let path = PathSolver::new(&scene, options, PathParameter::Voltage)
        .unwrap()
        .path(&pattern)
        .unwrap();
    let limit = path.limit().unwrap();
    let stretch = 4.0_f64.powf(1.0 / 6.0);
    let kappa = stretch.powi(-2) - stretch.powi(-8);
    let volts = (kappa / scene.kappa()).sqrt() * 20_000.0;
    assert!(
        limit.kind == EventKind::Fold && (limit.voltage / volts - 1.0).abs() < 1e-5,
        "{limit:?} {volts}"
    );
}
