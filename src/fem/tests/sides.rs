//! Sides that are free, on rollers, under loads, or on rigid bars.

use super::*;
use crate::precondition::Laplacian;

/// A scene of VHB 4910, 1 mm thick, with this geometry.
pub(super) fn scene(geometry: &str, voltage: f64) -> Scene {
    Scene::from_text(&format!(
        "geometry: {{ thickness: 1 mm, {geometry} }}\nmaterial: {{ model: neo-hookean, shear_modulus: 45 kPa, \
         relative_permittivity: 4.7 }}\ndrive: {{ voltage: {voltage} V }}\neffects: {{}}"
    ))
    .unwrap()
}

/// A strip that is held on the left, with free long sides and this support on the right.
fn strip(size: [f64; 2], prestretch: [f64; 2], cell: f64, right: &str, voltage: f64) -> Scene {
    let ([x, y], [a, b]) = (size, prestretch);
    let [columns, rows] = size.map(|side| (side / cell).round());
    scene(
        &format!(
            "size: [{x} mm, {y} mm], prestretch: [{a}, {b}], cells: [{columns}, {rows}], sides: {{ right: {right}, top: \
             free, bottom: free }}"
        ),
        voltage,
    )
}

pub(super) fn solver_of(scene: &Scene, mesh: Mesh) -> MembraneSolver {
    MembraneSolver::new(scene, SolveOptions { mesh, tolerance: 1e-10 }).unwrap()
}

/// The cells whose middle lies in these ranges in mm.
pub(super) fn cells_in(scene: &Scene, [left, right]: [f64; 2], [low, high]: [f64; 2]) -> Pattern {
    let membrane = scene.membrane();
    Pattern::from_fn(membrane.raster, |x, y| {
        let [x, y] = membrane.centre_mm(x, y);
        left < x && x < right && low < y && y < high
    })
}

pub(super) fn solved(scene: &Scene, mesh: Mesh, pattern: &Pattern) -> (Simulation, MeshSolution) {
    let solver = solver_of(scene, mesh);
    let solution = solver.solve(pattern);
    assert_eq!(solution.outcome, Outcome::Converged, "{:?}", scene.geometry);
    (solver.simulation(pattern, &solution), solution)
}

/// Device, active region, expected translation of the bar and rotation in rad, and a corner with a displacement.
type Known = (Scene, [[f64; 2]; 2], [f64; 2], f64, Option<([usize; 2], usize, f64)>);

#[test]
fn strips_with_bars_have_the_known_answers() {
    let none = [[0.0; 2]; 2];
    let (half, all) = ([0.0, 10.0], [0.0, 20.0]);
    let load = |force: &str| format!("{{ bar: {{ load: {force} }} }}");
    let cases: [Known; 6] = [
        (
            strip([20.0, 20.0], [2.0, 2.0], 2.0, &load("[0.3 N, 0 N]"), 0.0),
            none,
            [-8.871283, 0.0],
            0.0,
            Some(([5, 10], 1, -4.91053)),
        ),
        (
            strip([40.0, 20.0], [2.0, 2.0], 2.0, &load("[0.3 N, 0 N]"), 0.0),
            none,
            [-16.175593, 0.0],
            0.0,
            None,
        ),
        (
            strip([40.0, 20.0], [2.0, 2.0], 2.0, &load("[0.3 N, 0 N]"), 4000.0),
            [[4.0, 36.0], all],
            [-16.089768, 0.0],
            0.0,
            None,
        ),
        (
            strip([100.0, 20.0], [1.0, 1.0], 2.0, &load("[0.3 N, 0 N]"), 0.0),
            none,
            [12.26815, 0.0],
            0.0,
            None,
        ),
        (
            strip(
                [20.0, 20.0],
                [1.5, 1.5],
                2.0,
                "{ bar: { load: [0.4 N, 0 N], at: 4 mm } }",
                0.0,
            ),
            none,
            [-4.018777, -1.734257],
            -0.5355546,
            None,
        ),
        (
            strip([40.0, 20.0], [2.0, 1.0], 2.0, &load("[0.4 N, 0 N]"), 6000.0),
            [[4.0, 36.0], half],
            [-16.71907, 0.040093],
            0.0066008,
            None,
        ),
    ];
    for (scene, [along, across], translation, rotation, corner) in cases {
        let pattern = cells_in(&scene, along, across);
        let (found, solution) = solved(&scene, Mesh::biquadratic(1), &pattern);
        let motion = found.observation.bars.unwrap()[0];
        let error = (0..2)
            .map(|c| (motion.translation[c] - translation[c]).abs())
            .fold(0.0, f64::max);
        let turned = (motion.rotation.to_radians() - rotation).abs();
        println!(
            "{translation:?}: {error:.1e} {turned:.1e}, {} Newton, {} CG",
            solution.newton_iterations, solution.krylov_iterations
        );
        assert!(
            error < 2e-3 && turned < 2e-4,
            "{motion:?} for {translation:?}, {rotation}"
        );
        if let Some(([x, y], c, exact)) = corner {
            let value = found.field.unwrap().at_corner(x, y)[c];
            assert!((value - exact).abs() < 2e-3, "{value} for {exact}");
        }
    }
}

/// A part of a membrane on rollers on the left and the bottom, so that its state is uniform.
fn uniform(prestretch: f64, right: &str, top: &str, voltage: f64) -> Scene {
    scene(
        &format!(
            "size: [30 mm, 20 mm], prestretch: {prestretch}, cells: [3, 2], sides: {{ left: roller, bottom: roller, \
             right: {right}, top: {top} }}"
        ),
        voltage,
    )
}

#[test]
fn uniform_states_equal_the_closed_forms() {
    let stretches = |scene: &Scene, active: bool| {
        let pattern = Pattern::from_fn(scene.membrane().raster, |_, _| active);
        let (found, _) = solved(scene, Mesh::bilinear(1), &pattern);
        let [x, y] = found.field.unwrap().at_corner(3, 2);
        let prestretch = scene.prestretch();
        [prestretch[0] * (1.0 + x / 30.0), prestretch[1] * (1.0 + y / 20.0)]
    };
    // Released without voltage.
    for prestretch in [1.0, 1.7, 3.0, 4.0] {
        let [x, y] = stretches(&uniform(prestretch, "free", "free", 0.0), false);
        assert!(
            (x - 1.0).abs() < 1e-9 && (y - 1.0).abs() < 1e-9,
            "{prestretch}: {x} {y}"
        );
    }
    // A weight of 0.3 N on the right, at 4 kV.
    let [x, y] = stretches(&uniform(2.0, "{ load: [0.3 N, 0 N] }", "free", 4000.0), true);
    assert!(
        (x - 1.282334201).abs() < 2e-9 && (y - 0.888533362).abs() < 2e-9,
        "{x} {y}"
    );
    // Free, with κ: λ² − λ⁻⁴ = κλ⁴ for equal stretches.
    let volts = 3000.0_f64;
    let [x, y] = stretches(&uniform(3.0, "free", "free", volts), true);
    let kappa = 4.7 * 8.854_187_812_8e-12 * (volts / 1e-3).powi(2) / 45e3;
    assert!(
        (x - y).abs() < 1e-9 && (x.powi(2) - x.powi(-4) - kappa * x.powi(4)).abs() < 1e-8,
        "{x} {y}"
    );
}

#[test]
fn the_prestretch_is_only_where_displacements_count_from_if_nothing_holds_it() {
    // Length and width at a stretch of 1 are the same.
    let mut known: Option<f64> = None;
    for stretch in [1.0, 2.0, 3.3] {
        let size = [20.0 * stretch, 20.0];
        let text = format!(
            "size: [{} mm, 20 mm], prestretch: [{stretch}, 1], cells: [10, 10], sides: {{ right: {{ bar: {{ load: [0.2 \
             N, 0.01 N] }} }}, top: free, bottom: free }}",
            size[0]
        );
        let scene = scene(&text, 5000.0);
        let pattern = cells_in(&scene, [0.2 * size[0], 0.8 * size[0]], [0.0, 10.0]);
        let (found, _) = solved(&scene, Mesh::biquadratic(1), &pattern);
        let place = size[0] + found.observation.bars.unwrap()[0].translation[0];
        let first = *known.get_or_insert(place);
        assert!((place - first).abs() < 1e-8, "{stretch}: {place} {first}");
    }
}

/// Laws whose mount at large stretches is unstable under dead loads.
#[test]
fn laws_that_are_unstable_at_the_mount_are_released() {
    for law in [
        "model: mooney-rivlin, c2: 3 kPa",
        "model: yeoh, c2: -1 kPa, c3: 0.05 kPa",
        "model: ogden, terms: [ { mu: 52 kPa, alpha: 1.6 }, { mu: -3.4 kPa, alpha: -2 } ]",
    ] {
        for kind in ["uniform", "strip"] {
            let mut known: Option<[f64; 2]> = None;
            for stretch in [1.0, 2.0, 3.0] {
                // In the strip the bar and the left side keep the width.
                let (across, sides) = match kind {
                    "uniform" => (
                        stretch,
                        "left: roller, bottom: roller, right: { load: [0.05 N, 0 N] }, top: free",
                    ),
                    _ => (
                        1.0,
                        "right: { bar: { load: [0.05 N, 0.002 N] } }, top: free, bottom: free",
                    ),
                };
                let size = [20.0 * stretch, 10.0 * across];
                let text = format!(
                    "{{ geometry: {{ thickness: 1 mm, size: [{} mm, {} mm], prestretch: [{stretch}, {across}], \
                     cells: [8, 4], sides: {{ {sides} }} }}, material: {{ model: neo-hookean, shear_modulus: 45 kPa, \
                     relative_permittivity: 4.7 }}, drive: {{ voltage: 3 kV }}, effects: {{ strain_stiffening: {{ \
                     {law} }} }} }}",
                    size[0], size[1]
                );
                let scene = Scene::from_text(&text).unwrap();
                let pattern = cells_in(&scene, [0.25 * size[0], 0.75 * size[0]], [0.0, 0.5 * size[1]]);
                let (found, _) = solved(&scene, Mesh::biquadratic(1), &pattern);
                let corner = found.field.unwrap().at_corner(8, 4);
                let place = [0, 1].map(|c| size[c] + corner[c]);
                let first = *known.get_or_insert(place);
                let apart = (place[0] - first[0]).hypot(place[1] - first[1]);
                assert!(apart < 1e-7, "{law}, {kind}, {stretch}: {place:?} {first:?}");
            }
        }
    }
}

#[test]
fn the_preconditioner_inverts_the_laplacian_for_all_sides() {
    let words = [
        "held",
        "free",
        "roller",
        "{ bar: {} }",
        "{ bar: { moves: [x] } }",
        "{ bar: { moves: [y], spring: 1 N/m } }",
    ];
    let mut count = 0;
    for number in 0..words.len().pow(4) {
        let sides = [0, 1, 2, 3].map(|at| words[number / words.len().pow(at) % words.len()]);
        let [left, right, bottom, top] = sides;
        // The transforms are along the shorter sides.
        let [size, cells] = match number % 7 < 3 {
            true => ["[26 mm, 40 mm]", "[5, 8]"],
            false => ["[40 mm, 26 mm]", "[8, 5]"],
        };
        let text = format!(
            "{{ geometry: {{ thickness: 1 mm, size: {size}, prestretch: [3, 2], cells: {cells}, sides: {{ left: \
             {left}, right: {right}, bottom: {bottom}, top: {top} }} }}, material: {{ model: neo-hookean, \
             shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ voltage: 0 V }} }}"
        );
        let Ok(scene) = Scene::from_text(&text) else { continue };
        let mesh = if number % 5 < 2 {
            Mesh::bilinear(2)
        } else {
            Mesh::biquadratic(1)
        };
        let grid = Grid::uniform(mesh, &Sheet::of(&scene));
        let material = AnyMaterial::from(NeoHookean::without_thickness());
        let activity = Activity::new(&grid, &Pattern::from_fn(grid.raster(), |_, _| false));
        let operator = Operator::new(&material, &activity);
        let laplacian = Laplacian::new(&grid).unwrap();
        let mut u: Vec<f32> = (0..grid.layout().vector_len())
            .map(|i| ((i * i) as f32 * 0.037).sin())
            .collect();
        let zero = vec![0.0; u.len()];
        grid.restrict(&zero, &mut u);
        let (mut r, mut back) = (zero.clone(), zero.clone());
        operator.laplacian(&zero, &u, &mut r);
        laplacian.solve(&r, &grid.poses(&zero), &mut back, &mut laplacian.scratch());
        let worst = u.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let is_floating = (0..2).any(|c| (0..4).all(|side| grid.layout().free_sides().has(side / 2, side % 2, c)));
        let springs = sides.iter().any(|side| side.contains("spring"));
        if !is_floating && !springs {
            assert!(worst < 2e-3, "{sides:?}: {worst:e}");
            count += 1;
        }
    }
    assert!(count > 50, "{count}");
}

#[test]
fn tangents_are_derivatives_of_residuals_on_free_sides() {
    let scene = strip(
        [30.0, 20.0],
        [2.0, 1.5],
        5.0,
        "{ bar: { load: [0.3 N, 0.1 N], at: 4 mm, spring: 5 N/m } }",
        4000.0,
    );
    for mesh in [Mesh::bilinear(2), Mesh::biquadratic(1)] {
        let solver = solver_of(&scene, mesh);
        let grid = solver.grid();
        let activity = Activity::new(grid, &cells_in(&scene, [5.0, 20.0], [0.0, 10.0]));
        let material = AnyMaterial::from(NeoHookean::of(0.3, 0.2));
        let operator = Operator::new(&material, &activity);
        let len = grid.layout().vector_len();
        let u = waves(grid, 0.02, 0.2);
        let mut du = waves(grid, 0.02, 1.3);
        grid.restrict(&u, &mut du);
        let mut product = vec![0.0; len];
        operator.tangent(&u, &du, &mut product);
        let at = |step: f64| residual_after(&operator, &u, &du, step);
        let step = 1e-5;
        let (ahead, behind) = (at(step), at(-step));
        let difference: Vec<f64> = ahead.iter().zip(&behind).map(|(a, b)| (a - b) / (2.0 * step)).collect();
        let bar: Vec<usize> = grid.supports().unwrap().bodies()[0]
            .nodes
            .iter()
            .map(|(at, _)| at)
            .collect();
        let plane = len / 2;
        let worst = (0..len)
            .filter(|at| !bar.contains(&(at % plane)))
            .map(|at| (difference[at] - product[at]).abs())
            .fold(0.0, f64::max);
        assert!(
            worst < 1e-7 * norm(&product),
            "{mesh}: {worst:e} of {:e}",
            norm(&product)
        );
        // The factors have the same tangent.
        let factors = Factorisation::new(&operator, &u).unwrap();
        let back = factors.solve(&product);
        let worst = back.iter().zip(&du).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-10, "{mesh}: {worst:e}");
    }
}

#[test]
fn given_motions_of_bars_have_the_known_forces() {
    let given = |by: &str| format!("{{ bar: {{ displacement: {by} }} }}");
    // Size, prestretch, cell, motion, voltage, active range along x, force of the bar and of a corner.
    let blocked = strip([40.0, 20.0], [3.0, 1.0], 2.0, &given("[0 mm, 0 mm]"), 4000.0);
    let pulled = strip([10.0, 50.0], [1.0, 1.0], 1.0, &given("[5 mm, 0 mm]"), 0.0);
    for (scene, along, force, ([x, y], exact)) in [
        (blocked, [4.0, 36.0], 2.625177, ([10, 10], -2.809515)),
        (pulled, [0.0; 2], 2.651387, ([5, 50], -1.28089)),
    ] {
        let pattern = cells_in(&scene, along, [0.0, 50.0]);
        let (found, _) = solved(&scene, Mesh::biquadratic(1), &pattern);
        let [left, right, ..] = found.observation.reactions.unwrap();
        assert!((right[0] - force).abs() < 2e-4 * force, "{right:?} for {force}");
        assert!(
            (left[0] + right[0]).abs() < 1e-9 * force && left[1].abs() < 1e-9,
            "{left:?} {right:?}"
        );
        let moved = found.field.unwrap().at_corner(x, y)[1];
        assert!((moved - exact).abs() < 1e-3, "{moved} for {exact}");
    }
}

#[test]
fn forces_of_sides_balance_the_loads() {
    let text = "size: [30 mm, 20 mm], prestretch: [2, 1.5], cells: [6, 5], sides: { left: held, bottom: roller, right: { \
                load: [0.2 N, 0.05 N] }, top: { load: [0.03 N, 0.1 N] } }";
    let scene = scene(text, 5000.0);
    let pattern = cells_in(&scene, [5.0, 20.0], [4.0, 12.0]);
    for mesh in [Mesh::bilinear(2), Mesh::biquadratic(1)] {
        let (found, _) = solved(&scene, mesh, &pattern);
        let sides = found.observation.reactions.unwrap();
        let total = |c: usize| sides.iter().map(|force| force[c]).sum::<f64>();
        assert!(
            (total(0) + 0.23).abs() < 1e-9 && (total(1) + 0.15).abs() < 1e-9,
            "{mesh}: {sides:?}"
        );
    }
}

#[test]
fn gradients_on_free_sides_are_those_of_differences() {
    let scene = strip(
        [30.0, 20.0],
        [2.0, 1.5],
        5.0,
        "{ bar: { load: [0.3 N, 0.1 N], at: 4 mm } }",
        4000.0,
    );
    let solver = solver_of(&scene, Mesh::biquadratic(1));
    let pattern = cells_in(&scene, [5.0, 20.0], [0.0, 10.0]);
    let raster = scene.membrane().raster;
    let mut weights = vec![0.0; 2 * raster.corners()];
    // The lower corner of the bar, along both axes.
    let corner = raster.columns();
    (weights[2 * corner], weights[2 * corner + 1]) = (1.0, -0.5);
    let weights = Field::from_values(raster, weights).unwrap();
    check_gradient(&scene, &solver, &pattern, &weights, 0..raster.cells());
}

#[test]
fn gradients_of_forces_of_sides_are_those_of_differences() {
    let size = "size: [30 mm, 20 mm], prestretch: [2, 1.5], cells: [6, 4]";
    let bar = |right: &str, others: &str| scene(&format!("{size}, sides: {{ right: {right}, {others} }}"), 4000.0);
    let ends = "top: free, bottom: free";
    for (number, (scene, weights)) in [
        // Blocked, off its place, with a turn that is free or moves along one axis.
        (
            bar("{ bar: { displacement: [0 mm, 0 mm] } }", ends),
            [0.0, 1.0, 0.0, 0.0],
        ),
        (
            bar("{ bar: { displacement: [3 mm, 1 mm] } }", ends),
            [0.0, 0.8, 0.6, 0.0],
        ),
        (
            bar("{ bar: { displacement: [2 mm, 0 mm], moves: [turn] } }", ends),
            [0.0, 1.0, -0.5, 0.0],
        ),
        (
            bar("{ bar: { load: [0 N, 0.1 N], moves: [y, turn], at: 4 mm } }", ends),
            [0.0, 1.0, 0.0, 0.0],
        ),
        (
            bar("{ bar: { load: [0.3 N, 0 N], spring: 50 N/m } }", ends),
            [0.0, 1.0, 0.3, 0.0],
        ),
        // Held sides and rollers, whose corners count half, and a load beside a held side.
        (
            bar("{ load: [0.2 N, 0 N] }", "top: roller, bottom: held"),
            [1.0, 0.0, 0.5, 2.0],
        ),
    ]
    .into_iter()
    .enumerate()
    {
        let [left, x, y, top] = weights;
        let forces = [[left, 0.3 * left], [x, y], [0.0, 0.0], [0.0, top]];
        let raster = scene.membrane().raster;
        let weights = Field::zero(raster).with_reactions(forces);
        for pattern in [
            cells_in(&scene, [5.0, 20.0], [0.0, 10.0]),
            random_on(raster, number as u64),
        ] {
            let solver = solver_of(&scene, Mesh::biquadratic(1));
            check_gradient(&scene, &solver, &pattern, &weights, 0..raster.cells());
        }
    }
}

#[test]
fn the_change_of_a_force_counts_from_rest() {
    let scene = strip(
        [40.0, 20.0],
        [3.0, 1.0],
        2.0,
        "{ bar: { displacement: [0 mm, 0 mm] } }",
        4000.0,
    );
    let pattern = cells_in(&scene, [4.0, 36.0], [0.0, 20.0]);
    let right = |scene: &Scene| solved(scene, Mesh::bilinear(2), &pattern).0;
    let (found, at_rest) = (right(&scene), right(&scene.at_voltage(0.0)));
    let force = |found: &Simulation| found.observation.reactions.unwrap()[1][0];
    let change = 1e3 * (force(&found) - force(&at_rest));
    let [[left, _], [moved, across], ..] = *found.stroke().unwrap().reactions();
    assert!(change < -10.0 && (moved - change).abs() < 1e-6, "{moved} {change}");
    assert!((left + moved).abs() < 1e-6 && across.abs() < 1e-6, "{left} {across}");
    assert_eq!(at_rest.stroke().unwrap().reactions()[1], [0.0; 2]);
}

/// The voltage at which κ = ε(V/H)²/μ has a value.
fn voltage_for(kappa: f64) -> f64 {
    (kappa / uniform(1.0, "free", "free", 1.0).kappa()).sqrt()
}

fn path_of(scene: &Scene, parameter: PathParameter) -> LoadPath {
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-10,
    };
    let pattern = Pattern::from_fn(scene.membrane().raster, |_, _| true);
    PathSolver::new(scene, options, parameter)
        .unwrap()
        .path(&pattern)
        .unwrap()
}

#[test]
fn a_path_of_the_load_follows_the_closed_form_past_the_largest_load() {
    // At a constant voltage, s = l − l⁻²(1 − κl²)^(−½) has a maximum. The full load is s = 3.
    let kappa: f64 = 0.1;
    let load = |l: f64| l - 1.0 / (l * l * (1.0 - kappa * l * l).sqrt());
    let scene = uniform(1.0, "{ load: [2.7 N, 0 N] }", "free", voltage_for(kappa));
    let path = path_of(&scene, PathParameter::Load);
    let rest = path.rest.as_ref().unwrap().at_corner(3, 2);
    let stretch_across = |l: f64| ((1.0 - kappa * l * l).sqrt() * l).powf(-0.5);
    let moved = |l: f64| (30.0 * (l - 1.0) - rest[0]).hypot(20.0 * (stretch_across(l) - 1.0) - rest[1]);
    let (peak, largest) = (1000..3162)
        .map(|l| (1e-3 * f64::from(l), load(1e-3 * f64::from(l))))
        .fold((0.0, 0.0), |best, one| if one.1 > best.1 { one } else { best });
    let limit = path.limit().unwrap();
    assert_eq!((limit.kind, path.parameter), (EventKind::Fold, PathParameter::Load));
    assert!(
        (3.0 * limit.share / largest - 1.0).abs() < 1e-5,
        "{} {largest}",
        3.0 * limit.share
    );
    assert!(load(1.0 + rest[0] / 30.0).abs() < 1e-8);
    for (at, point) in path.points.iter().enumerate() {
        assert_eq!((point.voltage, point.stable), (scene.voltage_v(), at <= limit.point));
        let (mut low, mut high) = if at <= limit.point {
            (0.9, peak)
        } else {
            (kappa.powf(-0.5) * (1.0 - 1e-12), peak)
        };
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if load(middle) < 3.0 * point.share {
                low = middle;
            } else {
                high = middle;
            }
        }
        let error = (point.displacement - moved(low)).abs();
        // The load hardly changes with the stretch near the fold.
        let near = (point.share / limit.share - 1.0).abs() < 1e-3;
        assert!(error < if near { 0.5 } else { 1e-6 }, "{point:?}: {error}");
    }
    let end = path.limit_field.at_corner(3, 2)[0];
    assert!((load(1.0 + end / 30.0) / largest - 1.0).abs() < 1e-4);
}

#[test]
fn a_path_of_the_displacement_has_the_forces_of_pure_shear() {
    let kappa: f64 = 0.05;
    let scene = uniform(
        2.0,
        "{ bar: { displacement: [15 mm, 0 mm] } }",
        "roller",
        voltage_for(kappa),
    );
    let path = path_of(&scene, PathParameter::Displacement);
    assert_eq!((path.end, path.limit()), (PathEnd::Complete, None));
    assert!((path.points.last().unwrap().share - 1.0).abs() < 2e-9 && path.points.len() > 5);
    for point in &path.points {
        let sides = point.sides.as_ref().unwrap();
        let l = 2.0 + point.share;
        let stress = l - l.powi(-3) / 4.0 - kappa * 4.0 * l;
        // μHW = 0.45 N.
        let force = sides.reactions[1][0];
        assert!((force - 0.45 * stress).abs() < 1e-9, "{force} {stress}");
        assert!((sides.bars[0].translation[0] - 15.0 * point.share).abs() < 1e-9);
        assert!((point.max_displacement - 15.0 * point.share).abs() < 1e-8 && point.stable);
    }
}

#[test]
fn paths_agree_with_solutions_of_a_strip_with_a_bar() {
    let right = "{ bar: { load: [0.4 N, 0.05 N], at: 4 mm } }";
    let scene = strip([40.0, 20.0], [2.0, 1.0], 4.0, right, 4000.0);
    let pattern = cells_in(&scene, [4.0, 36.0], [0.0, 12.0]);
    let options = SolveOptions {
        mesh: Mesh::biquadratic(1),
        tolerance: 1e-10,
    };
    let path = PathSolver::new(&scene, options, PathParameter::Load)
        .unwrap()
        .path(&pattern)
        .unwrap();
    assert_eq!(path.end, PathEnd::Complete);
    let (found, _) = solved(&scene, Mesh::biquadratic(1), &pattern);
    let last = path.points.last().unwrap().sides.as_ref().unwrap();
    let (bar, reactions) = (found.observation.bars.unwrap()[0], found.observation.reactions.unwrap());
    let near = |a: [f64; 2], b: [f64; 2], error: f64| (0..2).all(|c| (a[c] - b[c]).abs() < error);
    assert!(
        near(last.bars[0].translation, bar.translation, 1e-6),
        "{last:?} {bar:?}"
    );
    assert!(last.reactions.into_iter().zip(reactions).all(|(a, b)| near(a, b, 1e-7)));
    assert!((last.bars[0].rotation - bar.rotation).abs() < 1e-5);
    for (parameter, error) in [
        (PathParameter::Displacement, SetupError::NoDisplacements),
        (PathParameter::Load, SetupError::NoLoads),
    ] {
        let unloaded = strip([40.0, 20.0], [2.0, 1.0], 4.0, "free", 0.0);
        assert_eq!(PathSolver::new(&unloaded, options, parameter).err(), Some(error));
    }
}

#[test]
fn a_path_of_the_displacement_keeps_the_loads_of_other_sides() {
    let sides =
        "sides: { right: { bar: { displacement: [5 mm, 1 mm] } }, top: { load: [0.02 N, 0.1 N] }, bottom: free }";
    let scene = scene(
        &format!("size: [40 mm, 20 mm], prestretch: [2, 1], cells: [10, 5], {sides}"),
        4000.0,
    );
    let path = path_of(&scene, PathParameter::Displacement);
    assert_eq!(path.end, PathEnd::Complete);
    let all = Pattern::from_fn(scene.membrane().raster, |_, _| true);
    let reactions = solved(&scene, Mesh::bilinear(1), &all).0.observation.reactions.unwrap();
    for point in &path.points {
        let found = point.sides.as_ref().unwrap().reactions;
        for (c, load) in [0.02, 0.1].into_iter().enumerate() {
            let sum: f64 = found.iter().map(|side| side[c]).sum();
            assert!((sum + load).abs() < 1e-8, "{sum} {load}");
        }
    }
    let last = path.points.last().unwrap().sides.as_ref().unwrap().reactions;
    let differences = last.into_iter().flatten().zip(reactions.into_iter().flatten());
    assert!(differences.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 1e-7);
}
