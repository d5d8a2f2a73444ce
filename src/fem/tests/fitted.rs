//! Elements that follow borders.

use std::sync::Arc;

use super::*;
use crate::effects::Model;
use deaflow_pattern::{Borders, Polygons};

type Point = [f64; 2];

fn scene(geometry: &str) -> Scene {
    Scene::from_text(&format!(
        "geometry: {{ thickness: 1 mm, {geometry} }}\nmaterial: {{ model: neo-hookean, shear_modulus: 45 kPa, \
         relative_permittivity: 4.7 }}\ndrive: {{ voltage: 5 kV }}\neffects: {{}}"
    ))
    .unwrap()
}

/// An ellipse turned anticlockwise by an angle in degrees, drawn with many corners.
fn ellipse(centre: Point, semiaxes: Point, angle: f64) -> Vec<Point> {
    let (sin, cos) = angle.to_radians().sin_cos();
    let count = 16_000;
    let point = |at: usize| {
        let t = std::f64::consts::TAU * at as f64 / f64::from(count);
        let [x, y] = [semiaxes[0] * t.cos(), semiaxes[1] * t.sin()];
        [centre[0] + cos * x - sin * y, centre[1] + sin * x + cos * y]
    };
    (0..count as usize).map(point).collect()
}

pub(super) fn disc(centre: Point, radius: f64) -> Polygons {
    Polygons::new(&[ellipse(centre, [radius; 2], 0.0)])
}

/// A device on a square of 50 mm whose elements follow borders.
fn solve(geometry: &str, borders: Borders, mesh: Mesh) -> (MembraneSolver, MeshSolution) {
    let scene = scene(geometry);
    let sheet = Sheet {
        borders: Some(Arc::new(borders)),
        ..Sheet::of(&scene)
    };
    let grid = Grid::fitted(mesh, &sheet).unwrap();
    let options = SolveOptions { mesh, tolerance: 1e-11 };
    let solver = MembraneSolver::on_grid(&scene, options, grid).unwrap();
    let bare = Pattern::from_fn(scene.membrane().raster, |_, _| false);
    let solution = solver.solve(&bare);
    assert!(solution.outcome.is_converged(), "{:?}", solution.outcome);
    (solver, solution)
}

fn disc_frame(cells: usize) -> String {
    disc_frame_on(50.0, cells)
}

fn disc_frame_on(side: f64, cells: usize) -> String {
    let middle = 0.5 * side;
    format!(
        "side: {side} mm, prestretch: 3, cells: {cells}, frame: {{ opening: {{ disc: {{ centre: [{middle} mm, \
         {middle} mm], radius: 20 mm }} }} }}"
    )
}

/// Errors at three radii of the disc of known displacement on a square with this side in mm.
fn errors_of_disc(side: f64, cells: usize, mesh: Mesh) -> [f64; 3] {
    let middle = 0.5 * side;
    let borders = Borders {
        opening: Some(disc([middle; 2], 20.0)),
        electrodes: Some(vec![(1, disc([middle; 2], 10.0))]),
        ..Borders::default()
    };
    let (solver, solution) = solve(&disc_frame_on(side, cells), borders, mesh);
    let field = solver.field(&solution);
    assert!(
        solution.krylov_iterations <= 10 * solution.newton_iterations,
        "{solution:?}"
    );
    let at = |r: f64| {
        let x = ((middle + r) * cells as f64 / side).round() as usize;
        field.at_corner(x, cells / 2)[0]
    };
    [
        at(5.0) - 0.524_117_306_8,
        at(10.0) - 1.048_234_613_7,
        at(15.0) - 0.407_739_308_4,
    ]
}

/// Returns the displacement at a corner of a cell of a membrane of 50 mm, in mm.
fn at(solver: &MembraneSolver, solution: &MeshSolution, [x, y]: Point) -> Point {
    let cells = solver.grid().raster().columns() as f64;
    let corner = [x, y].map(|at| (at / 50.0 * cells).round() as usize);
    solver.field(solution).at_corner(corner[0], corner[1])
}

#[test]
fn a_disc_has_its_known_displacement() {
    for (order, most, slope) in [(Order::Bilinear, 1.4e-3, 1.9), (Order::Biquadratic, 1e-5, 0.0)] {
        let all = [25, 50, 100].map(|cells| errors_of_disc(50.0, cells, Mesh::new(1, order)));
        let largest = all.map(|errors| errors.iter().fold(0.0_f64, |most, error| most.max(error.abs())));
        assert!(largest[1] < most, "{order:?} {all:?}");
        // Second order; biquadratic elements reach the precision of the outlines.
        assert!((largest[0] / largest[2]).log2() / 2.0 > slope, "{order:?} {all:?}");
    }
}

#[test]
fn a_round_frame_may_touch_the_sides() {
    // Between the frame and the sides, elements are as flat as one likes. They are all frame.
    for (order, elements, most) in [
        (Order::Bilinear, 2, 4e-4),
        (Order::Biquadratic, 1, 1e-5),
        (Order::Biquadratic, 3, 1e-6),
        (Order::Biquadratic, 4, 1e-6),
        (Order::Biquadratic, 8, 1e-6),
    ] {
        for side in [40.0, 40.000_1, 40.01] {
            let errors = errors_of_disc(side, 40, Mesh::new(elements, order));
            let largest = errors.iter().fold(0.0_f64, |most, error| most.max(error.abs()));
            // Corners of cells are not at the three radii.
            let most = most + 0.1 * (side - 40.0);
            assert!(largest < most, "{order:?} {elements} {side}: {errors:?}");
        }
    }
}

#[test]
fn round_electrodes_may_touch_or_cross_the_sides() {
    // At the sides, elements are flat, and curves may fold them: these are straight then.
    let membrane = Polygons::new(&[vec![[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]]]);
    let displacement = |radius: f64, mesh: Mesh| {
        let borders = Borders {
            electrodes: Some(vec![(1, disc([25.0; 2], radius).intersection(&membrane))]),
            ..Borders::default()
        };
        let (solver, solution) = solve("side: 50 mm, prestretch: 3, cells: 50", borders, mesh);
        let [x, y] = at(&solver, &solution, [42.0, 42.0]);
        assert!((x - y).abs() < 1e-6, "{radius} {mesh:?}: {x} {y}");
        x
    };
    for (radius, near) in [
        (24.9, 24.8),
        (24.999, 24.9),
        (25.0, 24.9),
        (25.01, 24.9),
        (25.3, 25.2),
        (26.0, 25.9),
    ] {
        let all = [1, 2, 3, 4].map(|elements| displacement(radius, Mesh::biquadratic(elements)));
        let slope = (displacement(near, Mesh::biquadratic(2)) - all[1]) / (near - radius);
        for found in all {
            assert!((found - all[3]).abs() < 1e-3, "{radius}: {all:?}");
        }
        // Without jumps as a function of the radius.
        assert!(slope.abs() < 0.4, "{radius}: {slope}");
    }
}

#[test]
fn round_devices_have_their_known_displacements() {
    let mesh = Mesh::biquadratic(1);
    // A hub of radius 5, with the electrode around it up to 10: closed form.
    let hub = "side: 50 mm, prestretch: 3, cells: 50, frame: { curves: fitted, opening: { ring: { centre: [25 mm, 25 \
               mm], radii: [5 mm, 20 mm] } } }";
    let ring = disc([25.0; 2], 10.0).without(&disc([25.0; 2], 5.0));
    let scene_borders = scene(hub).borders().unwrap();
    let borders = Borders {
        electrodes: Some(vec![(1, ring)]),
        ..(*scene_borders).clone()
    };
    let (solver, solution) = solve(hub, borders, mesh);
    for (r, known) in [(8.0, 0.537_415_42), (10.0, 0.828_606_71), (15.0, 0.322_289_29)] {
        let [u, v] = at(&solver, &solution, [25.0 + r, 25.0]);
        assert!((u - known).abs() < 5e-5 && v.abs() < 1e-6, "{r}: {u} {known} {v}");
    }
    // Ellipses: independent reference to 1e-5.
    let ellipses = "side: 50 mm, prestretch: 3, cells: 50, frame: { curves: fitted, opening: { ellipse: { centre: [25 \
                    mm, 25 mm], semiaxes: [21 mm, 15 mm], angle: 30 deg } } }";
    let borders = Borders {
        electrodes: Some(vec![(1, Polygons::new(&[ellipse([25.0; 2], [9.0, 6.0], -20.0)]))]),
        ..(*scene(ellipses).borders().unwrap()).clone()
    };
    let (solver, solution) = solve(ellipses, borders, mesh);
    for (point, known) in [
        ([35.0, 25.0], [0.609_26, 0.093_54]),
        ([17.0, 21.0], [-0.524_97, -0.373_67]),
    ] {
        let u = at(&solver, &solution, point);
        assert!(
            (0..2).all(|c| (u[c] - known[c]).abs() < 5e-5),
            "{point:?}: {u:?} {known:?}"
        );
    }
    // A turned rectangle: independent reference to 3e-6.
    let turned = "side: 50 mm, prestretch: 3, cells: 50, frame: { curves: fitted, opening: { rectangle: { corners: [[8 \
                  mm, 12 mm], [42 mm, 38 mm]], angle: 17 deg } } }";
    let borders = Borders {
        electrodes: Some(vec![(1, disc([21.0, 25.0], 7.0))]),
        ..(*scene(turned).borders().unwrap()).clone()
    };
    let (solver, solution) = solve(turned, borders, mesh);
    let u = at(&solver, &solution, [28.0, 25.0]);
    assert!(
        (u[0] - 0.899_26).abs() < 5e-5 && (u[1] + 0.012_21).abs() < 5e-5,
        "{u:?}"
    );
    // A body: independent reference to 2e-5.
    let body = "side: 50 mm, prestretch: 3, cells: 50, frame: { curves: fitted, opening: { disc: { centre: [25 mm, 25 \
                mm], radius: 20 mm } } }, bodies: [{ disc: { centre: [30 mm, 27 mm], radius: 4 mm }, curves: fitted, \
                load: [0.02 N, 0.01 N] }]";
    let borders = Borders {
        electrodes: Some(vec![(1, disc([17.0, 25.0], 6.0))]),
        ..(*scene(body).borders().unwrap()).clone()
    };
    let (solver, solution) = solve(body, borders, mesh);
    let motion = &solver.grid().motions(&solution.displacement).unwrap()[0];
    let known = [0.440_084, 0.093_809];
    assert!(
        (0..2).all(|c| (motion.translation[c] - known[c]).abs() < 5e-5),
        "{motion:?}"
    );
    assert!((motion.rotation.to_radians() - 7.7986e-4).abs() < 1e-5, "{motion:?}");
    let u = at(&solver, &solution, [23.0, 25.0]);
    assert!(
        (u[0] - 0.885_78).abs() < 5e-5 && (u[1] - 0.031_15).abs() < 5e-5,
        "{u:?}"
    );
    assert!(
        solution.krylov_iterations <= 12 * solution.newton_iterations,
        "{} in {}",
        solution.krylov_iterations,
        solution.newton_iterations
    );
}

/// Random values, the same on all machines.
fn wave(count: usize, phase: f64) -> Vec<f64> {
    (0..count).map(|i| ((i * i) as f64 * 0.37 + phase).sin()).collect()
}

#[test]
fn residuals_tangents_factors_and_gradients_of_mapped_elements_agree() {
    let geometry = "side: 50 mm, prestretch: [3, 3.5], cells: 20, frame: { curves: fitted, opening: { disc: { centre: [25 \
                    mm, 25 mm], radius: 20 mm } } }, bodies: [{ disc: { centre: [30 mm, 27 mm], radius: 4.2 mm }, \
                    curves: fitted, load: [0.02 N, 0.01 N] }]";
    let scene = scene(geometry);
    for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
        let solver = MembraneSolver::new(&scene, SolveOptions { mesh, tolerance: 1e-11 }).unwrap();
        let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| (6..13).contains(&x) && y > 7);
        let grid = solver.grid();
        let activity = Activity::new(grid, &pattern);
        let material = AnyMaterial::from(NeoHookean::new(scene.mean_prestretch(), scene.kappa()));
        let operator = Operator::new(&material, &activity);
        let solution = solver.solve(&pattern);
        assert!(solution.outcome.is_converged());
        let u = &solution.displacement;
        let len = u.len();
        let mut v = wave(len, 0.3);
        grid.restrict(u, &mut v);
        // The tangent is the derivative of the residual at the equilibrium, and symmetric.
        let step = 1e-4;
        let residual = |by: f64| {
            let mut at: Vec<f64> = u.iter().zip(&v).map(|(u, v)| u + by * v).collect();
            grid.settle(&mut at);
            let mut out = vec![0.0; len];
            assert!(operator.residual(&at, &mut out) > 0.0);
            out
        };
        let (plus, minus) = (residual(step), residual(-step));
        let mut image = vec![0.0; len];
        operator.tangent(u, &v, &mut image);
        let mut w = wave(len, 1.9);
        grid.restrict(u, &mut w);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let slope = (dot(&plus, &w) - dot(&minus, &w)) / (2.0 * step);
        let tangent = dot(&image, &w);
        assert!(
            (slope - tangent).abs() < 1e-5 * norm(&image) * norm(&w),
            "{mesh}: {slope} {tangent}"
        );
        let mut other = vec![0.0; len];
        operator.tangent(u, &w, &mut other);
        assert!(
            (tangent - dot(&other, &v)).abs() < 1e-10 * norm(&image) * norm(&w),
            "{mesh}"
        );
        // The assembled tangent is the same.
        let factors = Factorisation::new(&operator, u).unwrap();
        let back = factors.solve(&image);
        let worst = back.iter().zip(&v).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-8, "{mesh}: {worst:e}");
        // Gradients with respect to cells, also those that the frame cuts, are the slopes of differences.
        let raster = scene.membrane().raster;
        let weights: Vec<f64> = wave(raster.corners() * 2, 0.7);
        let weights = Field::from_values(raster, weights).unwrap();
        let load = grid.spread(&weights, u);
        let mut values = vec![];
        let cells = [(12, 9), (6, 15), (4, 12), (15, 13)];
        let value = |shares: &dyn Fn(usize, usize) -> f64| {
            let activity = Activity::from_shares(grid, shares);
            let operator = Operator::new(&material, &activity);
            let mut at = u.clone();
            newton_by_factors(&operator, &vec![0.0; len], &mut at);
            let field = grid.sample(&at);
            dot(field.values(), weights.values()) / grid.unit_mm()
        };
        let shares = |x: usize, y: usize| f64::from(u8::from(pattern.is_active(x, y)));
        for cell in cells {
            let by = |by: f64| move |x: usize, y: usize| if (x, y) == cell { by } else { 0.0 };
            let step = 1e-3;
            let (plus, minus) = (by(step), by(-step));
            let difference = value(&|x, y| shares(x, y) + plus(x, y)) - value(&|x, y| shares(x, y) + minus(x, y));
            values.push(difference / (2.0 * step));
        }
        let adjoint = factors.solve(&load);
        let gradient = crate::adjoint::of_cells(&operator, u, &adjoint);
        for ((x, y), slope) in cells.into_iter().zip(values) {
            let found = gradient[y * raster.columns() + x];
            assert!(
                (found - slope).abs() < 1e-4 * (slope.abs() + 1e-3),
                "{mesh} {x} {y}: {found} {slope}"
            );
        }
    }
}

#[test]
fn random_polygons_keep_their_area_or_are_refused() {
    let mut stream = Stream::new(7, "polygons", 0);
    let mut refused = 0;
    for _ in 0..60 {
        let count = 3 + (stream.uniform() * 4.0) as usize;
        let mut angles: Vec<f64> = (0..count).map(|_| std::f64::consts::TAU * stream.uniform()).collect();
        angles.sort_by(f64::total_cmp);
        let corners: Vec<Point> = angles
            .iter()
            .map(|angle| {
                let r = 8.0 + 12.0 * stream.uniform();
                [25.0 + r * angle.cos(), 25.0 + r * angle.sin()]
            })
            .collect();
        let region = Polygons::new(&[corners]);
        let sheet = Sheet {
            borders: Some(Arc::new(Borders {
                opening: Some(region.clone()),
                ..Borders::default()
            })),
            ..Sheet::of(&scene(&disc_frame(50)))
        };
        let grid = match Grid::fitted(Mesh::biquadratic(1), &sheet) {
            Ok(grid) => grid,
            Err(_) => {
                refused += 1;
                continue;
            }
        };
        let inside = grid
            .each_element()
            .filter(|element| grid.content(*element).part == deaflow_pattern::Part::Membrane);
        let area: f64 = inside.map(|element| grid.area_of(element)).sum();
        assert!((area - region.area()).abs() < 0.05, "{area} {}", region.area());
    }
    assert!(refused <= 2, "{refused} of 60");
}

#[test]
fn a_disc_vibrates_at_the_known_frequencies() {
    // Without voltage and at a large prestretch, where the pressure of incompressibility vanishes, both components obey
    // the wave equation: the lowest frequency of a disc of radius R, twice, is j₀c/(2πR) with j₀ = 2.4048255577.
    let scene = Scene::from_text(
        "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 10, cells: 24, frame: { curves: fitted, opening: { disc: { \
         centre: [25 mm, 25 mm], radius: 20 mm } } } }\nmaterial: { model: neo-hookean, shear_modulus: 45 kPa, \
         relative_permittivity: 4.7 }\nproperties: { density: 960 kg/m3 }\ndrive: { voltage: 0 V }\neffects: {}",
    )
    .unwrap();
    let bare = Pattern::from_fn(scene.membrane().raster, |_, _| false);
    let speed = 10.0 * (45e3_f64 / 960.0).sqrt();
    let known = 2.404_825_557_7 * speed / (std::f64::consts::TAU * 0.02);
    for (mesh, most) in [(Mesh::bilinear(1), 5e-3), (Mesh::biquadratic(1), 2e-5)] {
        let solver = MembraneSolver::new(&scene, SolveOptions::on(mesh)).unwrap();
        let found = solver.vibration(&bare, 2, false).unwrap();
        for frequency in &found.frequencies[..2] {
            assert!((frequency / known - 1.0).abs() < most, "{mesh}: {frequency} {known}");
        }
    }
}

#[test]
fn fitted_devices_have_the_symmetries_of_their_shapes() {
    let scene = Scene::from_text(
        "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 20, frame: { curves: fitted, opening: { disc: { \
         centre: [25 mm, 25 mm], radius: 21 mm } }, held: [{ rectangle: { corners: [[22 mm, 22 mm], [28 mm, 28 mm]], \
         angle: 45 deg } }] } }\nmaterial: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }\n\
         drive: { voltage: 4 kV }\neffects: {}",
    )
    .unwrap();
    let symmetries = scene.symmetries();
    assert_eq!(symmetries.count(), 8);
    let free = scene.parts().unwrap().free_cells();
    let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| {
        free.has(x, y) && (x * 7 + y * 3) % 5 < 2
    });
    for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
        let solver = MembraneSolver::new(&scene, SolveOptions { mesh, tolerance: 1e-11 }).unwrap();
        let field = solver.field(&solver.solve(&pattern));
        for g in symmetries.iter() {
            let turned = solver.field(&solver.solve(&pattern.transformed(g)));
            let pairs = field
                .transformed(g)
                .values()
                .to_vec()
                .into_iter()
                .zip(turned.values().to_vec());
            let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            // Outlines are straight over 1e-6 mm.
            assert!(worst < 1e-6 * field.max_magnitude().max(1.0), "{mesh} {g:?} {worst:e}");
        }
    }
}

#[test]
fn borders_along_cells_change_nothing() {
    let rectangle = |curves: &str| {
        scene(&format!(
            "side: 50 mm, prestretch: 3, cells: 25, frame: {{ {curves} opening: {{ rectangle: [[4 mm, 6 mm], [44 mm, 40 \
             mm]] }} }}, bodies: [{{ {curves} rectangle: [[20 mm, 20 mm], [26 mm, 28 mm]] }}]"
        ))
    };
    let (fitted, cells) = (rectangle("curves: fitted,"), rectangle(""));
    for mesh in [Mesh::bilinear(2), Mesh::biquadratic(1)] {
        let [one, other] = [&fitted, &cells].map(|scene| Model::new(scene).unwrap().grid(mesh).unwrap());
        assert!(one.follows_borders().is_none() && one == other);
    }
}

/// The scene with drawn electrode groups.
pub(super) fn drawn(scene: &Scene, groups: &[(u8, Polygons)]) -> Scene {
    let electrodes = deaflow_pattern::Electrodes::new(groups, scene.membrane().size_mm);
    let bare = Pattern::from_fn(scene.membrane().raster, |_, _| false);
    let pattern = bare.with_electrodes(Some(Arc::new(electrodes)));
    scene.with_electrodes_of(&pattern).into_owned()
}

/// A random device with drawn electrodes, of one of several kinds, with the regions of the groups.
fn random_device(kind: usize, stream: &mut Stream) -> (Scene, Vec<(u8, Polygons)>) {
    let round = "frame: { curves: fitted, opening: { disc: { centre: [25 mm, 25 mm], radius: 20 mm } } }";
    let body = "frame: { curves: fitted, opening: { disc: { centre: [25 mm, 25 mm], radius: 20 mm } } }, bodies: [{ \
                disc: { centre: [29 mm, 26 mm], radius: 4.3 mm }, curves: fitted }]";
    let cells = "frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 20 mm } } }";
    let (parts, spread) = match kind {
        0 | 1 | 3 => (round, 12.0),
        4 => (body, 6.0),
        5 => (cells, 12.0),
        _ => ("prestretch: 3", 20.0),
    };
    let prestretch = if parts.starts_with("frame") {
        "prestretch: 3, "
    } else {
        ""
    };
    let scene = scene(&format!("side: 50 mm, cells: 50, {prestretch}{parts}"));
    let mut near = |spread: f64| {
        [
            25.0 + spread * (stream.uniform() - 0.5),
            25.0 + spread * (stream.uniform() - 0.5),
        ]
    };
    let centre = near(spread);
    let angle = 360.0 * stream.uniform();
    let radius = stream.range(3.0, 9.0);
    let turned = |[x, y]: Point| {
        let (sin, cos) = angle.to_radians().sin_cos();
        [centre[0] + cos * x - sin * y, centre[1] + sin * x + cos * y]
    };
    let bar = |low: Point, high: Point| {
        let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
        Polygons::new(&[corners.map(turned).to_vec()])
    };
    let groups = match kind {
        0 | 4 | 5 => vec![(1, disc(centre, radius))],
        // A ring with a lead to the frame.
        1 | 6 => {
            let width = stream.range(1.0, 2.5);
            let ring = disc(centre, radius).without(&disc(centre, 0.5 * radius));
            vec![(1, ring.union(&bar([0.75 * radius, -width], [50.0, width])))]
        }
        2 => {
            let semiaxes = [radius, stream.range(2.0, 6.0)];
            vec![(1, Polygons::new(&[ellipse(centre, semiaxes, angle)]))]
        }
        // Two halves of a disc.
        _ => {
            let half = bar([-50.0, -50.0], [0.0, 50.0]);
            let whole = disc(centre, radius);
            vec![(1, whole.intersection(&half)), (2, whole.without(&half))]
        }
    };
    (scene, groups)
}

#[test]
fn random_electrodes_keep_their_area_or_are_refused() {
    let mut stream = Stream::new(11, "electrodes", 0);
    let mut faults = Vec::new();
    for kind in 0..8 {
        for trial in 0..10 {
            let (scene, groups) = random_device(kind, &mut stream);
            let scene = drawn(&scene, &groups);
            let sheet = Sheet::of(&scene);
            let grid = match Grid::fitted(Mesh::biquadratic(1), &sheet) {
                Ok(grid) => grid,
                Err(fault) => {
                    faults.push(format!("{kind} {trial}: {fault}"));
                    continue;
                }
            };
            for (group, region) in sheet.borders.as_ref().unwrap().electrodes.iter().flatten() {
                let inside = grid.each_element().filter(|element| {
                    let content = grid.content(*element);
                    content.part == deaflow_pattern::Part::Membrane && content.group == Some(*group)
                });
                let area: f64 = inside.map(|element| grid.area_of(element)).sum();
                assert!(
                    (area - region.area()).abs() < 0.05,
                    "{kind} {trial}: {area} {}",
                    region.area()
                );
            }
        }
    }
    assert!(faults.len() <= 3, "{faults:#?}");
}

#[test]
fn corners_of_cells_have_the_values_of_linear_fields() {
    let mut stream = Stream::new(3, "corners", 0);
    for kind in (0..8).cycle().take(40) {
        let (scene, groups) = random_device(kind, &mut stream);
        let scene = drawn(&scene, &groups);
        for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
            let Ok(grid) = Grid::fitted(mesh, &Sheet::of(&scene)) else {
                continue;
            };
            let (layout, unit) = (grid.layout(), grid.unit_mm());
            let value = |[x, y]: Point, c: usize| [0.3 * x - 0.2 * y + 0.1, 0.7 * y + 0.4 * x][c];
            let mut u = vec![0.0; layout.vector_len()];
            let [columns, rows] = layout.nodes();
            for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
                let at = grid.node_position([column, row]).map(|at| at * unit);
                (0..2).for_each(|c| u[layout.index(c, column, row)] = value(at, c) / unit);
            }
            let field = grid.sample(&u);
            for (x, y) in (0..51).flat_map(|y| (0..51).map(move |x| (x, y))) {
                let found = field.at_corner(x, y);
                let known = [0, 1].map(|c| value([x as f64, y as f64], c));
                let off = (0..2).map(|c| (found[c] - known[c]).abs()).fold(0.0, f64::max);
                assert!(off < 1e-9, "kind {kind}, {mesh}, corner {x} {y}: {found:?} {known:?}");
            }
        }
    }
}

/// A device on a rectangle with an electrode whose edges elements follow.
fn with_electrode(size: &str, cells: &str, region: &Polygons) -> Scene {
    let scene = scene(&format!("size: {size}, cells: {cells}, prestretch: 3"));
    drawn(&scene, &[(1, region.clone())])
}

#[test]
fn rasters_that_are_not_square_have_fitted_electrodes_too() {
    let region = Polygons::new(&[ellipse([31.0, 14.0], [11.3, 6.7], 20.0)]);
    let exchanged = Polygons::new(&[ellipse([14.0, 31.0], [6.7, 11.3], -20.0)]);
    for (mesh, most) in [(Mesh::bilinear(1), 5e-3), (Mesh::biquadratic(1), 1e-3)] {
        let options = SolveOptions { mesh, tolerance: 1e-11 };
        let field = |scene: &Scene| {
            let solver = MembraneSolver::new(scene, options).unwrap();
            let bare = Pattern::from_fn(scene.membrane().raster, |_, _| false);
            let solution = solver.solve(&bare);
            assert!(solution.outcome.is_converged(), "{mesh}: {:?}", solution.outcome);
            solver.field(&solution)
        };
        let wide = field(&with_electrode("[60 mm, 30 mm]", "[40, 16]", &region));
        let high = field(&with_electrode("[30 mm, 60 mm]", "[16, 40]", &exchanged));
        let mut worst = 0.0_f64;
        for (x, y) in (0..=16).flat_map(|y| (0..=40).map(move |x| (x, y))) {
            let ([a, b], [c, d]) = (wide.at_corner(x, y), high.at_corner(y, x));
            worst = worst.max((a - d).abs()).max((b - c).abs());
        }
        assert!(worst < most * wide.max_magnitude(), "{mesh}: {worst:e}");
    }
}

#[test]
fn electrodes_that_elements_lose_are_refused_and_straight_edges_are_followed() {
    let grid = |region: &Polygons| {
        let scene = with_electrode("[50 mm, 50 mm]", "20", region);
        Grid::fitted(Mesh::bilinear(1), &Sheet::of(&scene))
    };
    let bar = |low: Point, high: Point| Polygons::new(&[vec![low, [high[0], low[1]], high, [low[0], high[1]]]]);
    let large = disc([12.0, 36.0], 5.0);
    for lost in [
        disc([26.2, 26.2], 0.3),
        bar([5.0, 25.0], [45.0, 25.007]),
        large.union(&disc([31.3, 31.2], 0.12)),
        large.without(&disc([12.4, 36.3], 0.2)),
    ] {
        let error = grid(&lost).unwrap_err().to_string();
        assert!(
            error.contains("smaller than its shape") || error.contains("larger than its shape"),
            "{error}"
        );
        assert!(error.contains(", near ["), "{error}");
    }
    for offset in 0..25 {
        let edge = 24.0 + 0.1 * f64::from(offset);
        assert!(grid(&bar([-1.0, -1.0], [edge, 52.0])).is_ok(), "{edge}");
        assert!(grid(&bar([-1.0, -1.0], [52.0, edge])).is_ok(), "{edge}");
    }
}
