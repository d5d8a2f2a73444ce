//! Frames and rigid bodies.

use super::*;
use crate::precondition::Laplacian;

/// A scene of VHB 4910, 1 mm thick, with this geometry.
fn scene(geometry: &str, voltage: f64) -> Scene {
    Scene::from_text(&format!(
        "geometry: {{ thickness: 1 mm, {geometry} }}\nmaterial: {{ model: neo-hookean, shear_modulus: 45 kPa, \
         relative_permittivity: 4.7 }}\ndrive: {{ voltage: {voltage} V }}\neffects: {{}}"
    ))
    .unwrap()
}

const DISC: &str =
    "side: 50 mm, prestretch: 3, cells: 50, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 20 mm } } }";
const HUB: &str = "side: 50 mm, prestretch: 3, cells: 25, frame: { opening: { disc: { centre: [25 mm, 25 mm], \
                   radius: 22 mm } }, held: [{ rectangle: [[21 mm, 21 mm], [29 mm, 27 mm]] }] }";
const TIP: &str = "size: [60 mm, 30 mm], prestretch: [3, 4], cells: [30, 18], \
                   bodies: [{ rectangle: [[38 mm, 10 mm], [46 mm, 20 mm]], load: [0.02 N, 0.01 N], spring: 2 N/m }]";
const ROTORS: &str = "side: 50 mm, prestretch: 3, cells: 25, frame: { held: [{ disc: { centre: [44 mm, 44 mm], \
                      radius: 3 mm } }] }, bodies: [{ polygon: [[10 mm, 18 mm], [30 mm, 18 mm], [30 mm, 24 mm], \
                      [16 mm, 24 mm], [16 mm, 36 mm], [10 mm, 36 mm]] }, { disc: { centre: [36 mm, 34 mm], \
                      radius: 5 mm }, load: [0 N, -30 mN] }]";

const ALL: [&str; 4] = [DISC, HUB, TIP, ROTORS];

fn solver_of(scene: &Scene, mesh: Mesh) -> MembraneSolver {
    MembraneSolver::new(scene, SolveOptions { mesh, tolerance: 1e-11 }).unwrap()
}

/// Active on the right of an oblique line.
fn half_of(scene: &Scene) -> Pattern {
    let membrane = scene.membrane();
    let [width, height] = membrane.size_mm;
    Pattern::from_fn(membrane.raster, |x, y| {
        let [x, y] = membrane.centre_mm(x, y);
        x / width + 0.3 * y / height > 0.6
    })
}

/// An admissible displacement with rotated bodies.
fn allowed(grid: &Grid, size: f64, phase: f64) -> Vec<f64> {
    let mut u: Vec<f64> = (0..grid.layout().vector_len())
        .map(|i| size * (i as f64 * 0.61 + phase).sin())
        .collect();
    grid.layout().clear_frame(&mut u);
    if let Some(supports) = grid.supports() {
        let rest = vec![Pose::REST; supports.bodies().len()];
        supports.restrict(&rest, &mut u);
        for body in supports.bodies() {
            body.nodes
                .write(&Pose::REST, [0.3 * size, -0.2 * size, 0.04 * phase.cos()], &mut u);
        }
        supports.settle(&mut u);
    }
    u
}

#[test]
fn the_laplacian_is_inverted_whatever_frames_and_bodies_do() {
    for (geometry, mesh) in ALL
        .into_iter()
        .flat_map(|geometry| [Mesh::bilinear(1), Mesh::bilinear(2), Mesh::biquadratic(1)].map(|mesh| (geometry, mesh)))
    {
        let scene = scene(geometry, 0.0);
        let grid = Grid::uniform(mesh, &Sheet::of(&scene));
        let activity = Activity::new(&grid, &Pattern::from_fn(grid.raster(), |_, _| false));
        let material = AnyMaterial::from(NeoHookean::new(3.0, 0.0));
        let operator = Operator {
            body_load: 0.0,
            ..Operator::new(&material, &activity)
        };
        let at: Vec<f32> = allowed(&grid, 0.02, 0.3).into_iter().map(|u| u as f32).collect();
        let poses = grid.poses(&at);
        let mut wanted: Vec<f32> = (0..at.len()).map(|i| ((i * i) as f32 * 0.037).sin()).collect();
        grid.restrict(&at, &mut wanted);
        let (mut r, mut found) = (vec![0.0; at.len()], vec![0.0; at.len()]);
        operator.laplacian(&at, &wanted, &mut r);
        // The preconditioner includes springs.
        let supports = grid.supports().unwrap();
        let springs: Vec<[f64; 3]> = supports
            .bodies()
            .iter()
            .zip(&poses)
            .map(|(body, pose)| {
                let [p, q, _] = body.nodes.motion(pose, body.nodes.force(pose, &wanted));
                [body.mount.spring[0] * p, body.mount.spring[1] * q, 0.0]
            })
            .collect();
        supports.restrict_with(&poses, &mut r, |body, force| {
            std::array::from_fn(|k| force[k] + springs[body][k])
        });
        let laplacian = Laplacian::new(&grid).unwrap();
        laplacian.solve(&r, &poses, &mut found, &mut laplacian.scratch());
        let worst = wanted
            .iter()
            .zip(&found)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(worst < 2e-3, "{geometry} {mesh}: {worst:e}");
    }
}

#[test]
fn residual_and_tangent_are_derivatives_on_what_is_allowed() {
    for (geometry, mesh) in ALL
        .into_iter()
        .flat_map(|geometry| [Mesh::bilinear(1), Mesh::biquadratic(1)].map(|mesh| (geometry, mesh)))
    {
        let scene = scene(geometry, 4e3);
        let grid = Grid::uniform(mesh, &Sheet::of(&scene));
        let activity = Activity::new(&grid, &random_on(grid.raster(), 2));
        let material = AnyMaterial::from(NeoHookean::new(scene.mean_prestretch(), scene.kappa()));
        let operator = Operator::new(&material, &activity);
        // Near an equilibrium with rotated bodies.
        let mut u = solver_of(&scene, mesh).solve(&half_of(&scene)).displacement;
        u.iter_mut()
            .zip(allowed(&grid, 0.01, 0.4))
            .for_each(|(u, more)| *u += more);
        grid.settle(&mut u);
        let mut du: Vec<f64> = (0..u.len()).map(|i| (i as f64 * 0.37).cos()).collect();
        grid.restrict(&u, &mut du);
        // Along a path of admissible displacements: bodies rotate, so that their nodes leave straight lines.
        let moved = |by: f64| {
            let mut moved: Vec<f64> = u.iter().zip(&du).map(|(u, d)| u + by * d).collect();
            if let Some(supports) = grid.supports() {
                for (body, pose) in supports.bodies().iter().zip(grid.poses(&u)) {
                    let [p, q, turn] = body.nodes.motion(&pose, body.nodes.force(&pose, &du));
                    let (sin, cos) = (pose.angle() + by * turn).sin_cos();
                    let [x, y] = pose.translation;
                    body.nodes.place(
                        &Pose {
                            translation: [x + by * p, y + by * q],
                            turn: [cos, sin],
                        },
                        &mut moved,
                    );
                }
            }
            moved
        };
        let energy = |u: &[f64]| {
            let bodies = grid.supports().map_or(0.0, |supports| supports.energy(&grid.poses(u)));
            discrete::energy(&Sheet::of(&scene), &activity, scene.kappa(), u) + bodies
        };
        let (mut r, mut image, step) = (vec![0.0; u.len()], vec![0.0; u.len()], 1e-5);
        let admissible = operator.residual(&u, &mut r);
        assert!(admissible > 0.0, "{geometry} {mesh}: {admissible}");
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let slope = (energy(&moved(step)) - energy(&moved(-step))) / (2.0 * step);
        let size = norm(&r) * norm(&du);
        assert!(
            (slope - dot(&r, &du)).abs() < 2e-7 * size,
            "{geometry} {mesh}: {slope} {}",
            dot(&r, &du)
        );
        // The second derivative along the path is that of the tangent.
        operator.tangent(&u, &du, &mut image);
        let step = 2e-3;
        let curvature = (energy(&moved(step)) - 2.0 * energy(&u) + energy(&moved(-step))) / (step * step);
        let quadratic = dot(&image, &du);
        assert!(
            (curvature / quadratic - 1.0).abs() < 1e-4,
            "{geometry} {mesh}: {curvature} {quadratic}"
        );
        // And the tangent is symmetric.
        let mut other: Vec<f64> = (0..u.len()).map(|i| (i as f64 * 0.21).sin()).collect();
        grid.restrict(&u, &mut other);
        let mut other_image = vec![0.0; u.len()];
        operator.tangent(&u, &other, &mut other_image);
        assert!((dot(&image, &other) - dot(&other_image, &du)).abs() < 1e-9 * norm(&image) * norm(&other));
    }
}

#[test]
fn factors_and_conjugate_gradients_agree_and_take_as_many_iterations_as_on_the_rectangle() {
    for (geometry, mesh) in ALL
        .into_iter()
        .flat_map(|geometry| [Mesh::bilinear(2), Mesh::biquadratic(1)].map(|mesh| (geometry, mesh)))
    {
        let scene = scene(geometry, 4e3);
        let solver = solver_of(&scene, mesh);
        let pattern = random_on(solver.grid().raster(), 6);
        let solution = solver.solve(&pattern);
        assert_eq!(solution.outcome, Outcome::Converged, "{geometry}");
        let material = AnyMaterial::from(NeoHookean::new(scene.mean_prestretch(), scene.kappa()));
        let activity = Activity::new(solver.grid(), &pattern);
        let operator = Operator::new(&material, &activity);
        let mut u = vec![0.0; solution.displacement.len()];
        newton_by_factors(&operator, &vec![0.0; u.len()], &mut u);
        let gap = u
            .iter()
            .zip(&solution.displacement)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(gap < 1e-8, "{geometry} {mesh}: {gap:e}");
        assert_eq!(Factorisation::new(&operator, &u).unwrap().negative_pivots(), 0);
        let per_step = f64::from(solution.krylov_iterations) / f64::from(solution.newton_iterations);
        let plain = Scene::vhb4910().at_voltage(4e3);
        let square = solver_of(&plain, mesh).solve(&random(6));
        let of_square = f64::from(square.krylov_iterations) / f64::from(square.newton_iterations);
        assert!(
            per_step < 1.6 * of_square + 1.0,
            "{geometry} {mesh}: {per_step} {of_square}"
        );
    }
}

/// Axisymmetric displacements at 5 kV by a high-order method; the error of a staircase of cells is of first order in
/// their side.
#[test]
fn a_disc_frame_has_the_axisymmetric_displacement_up_to_its_staircase() {
    let known = [(10.0, 1.0482346137), (15.0, 0.4077393084), (5.0, 0.5241173068)];
    for (cells, error) in [(50, 0.02), (100, 0.01)] {
        let scene = scene(&DISC.replace("cells: 50", &format!("cells: {cells}")), 5e3);
        let solver = solver_of(&scene, Mesh::biquadratic(1));
        let (membrane, per_mm) = (scene.membrane(), cells / 50);
        let pattern = Pattern::from_fn(membrane.raster, |x, y| {
            let [x, y] = membrane.centre_mm(x, y);
            (x - 25.0).hypot(y - 25.0) < 10.0
        });
        let field = solver.field(&solver.solve(&pattern));
        for (radius, exact) in known {
            let away = (25 + radius as usize) * per_mm;
            let found = field.at_corner(away, 25 * per_mm)[0];
            assert!((found - exact).abs() < error, "{cells}, {radius}: {found} {exact}");
        }
        assert!(field.at_corner(25 * per_mm, 25 * per_mm).iter().all(|u| u.abs() < 1e-9));
        assert_eq!(field.at_corner(2 * per_mm, 2 * per_mm), [0.0, 0.0]);
    }
}

#[test]
fn a_free_body_is_where_no_force_is_left_and_a_spring_draws_it_back() {
    let at = |pull: &str| {
        let geometry = format!(
            "side: 50 mm, prestretch: 3, cells: 25, bodies: [{{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]]{pull} }}]"
        );
        let scene = scene(&geometry, 5e3);
        let solver = solver_of(&scene, Mesh::bilinear(2));
        let pattern = Pattern::from_fn(scene.membrane().raster, |x, _| x < 10);
        let solution = solver.solve(&pattern);
        assert_eq!(solution.outcome, Outcome::Converged);
        let pose = solver.grid().poses(&solution.displacement)[0];
        let [x, y] = pose.translation.map(|t| t * solver.grid().unit_mm());
        assert!(y.abs() < 1e-9 && pose.angle().abs() < 1e-9);
        x
    };
    let free = at("");
    // The active left half pushes it to the right.
    assert!(free > 0.5, "{free}");
    // Linear: a spring with the stiffness of the membrane halves the motion, a load equal to the force of the spring
    // restores it.
    let drawn = at(", spring: 50 N/m");
    assert!(drawn > 0.1 * free && drawn < 0.9 * free, "{drawn}");
    let force = 0.05 * drawn;
    assert!((at(&format!(", spring: 50 N/m, load: [{force} N, 0 N]")) - at("")).abs() < 0.2 * free);
    // A load alone holds it at the same position as the spring.
    assert!((at(&format!(", load: [{} N, 0 N]", -force)) - drawn).abs() < 1e-6);
}

#[test]
fn transposed_devices_have_transposed_fields_and_a_device_its_own_symmetries() {
    let device = "size: [30 mm, 60 mm], prestretch: [4, 3], cells: [18, 30], \
                  bodies: [{ rectangle: [[10 mm, 38 mm], [20 mm, 46 mm]], load: [0.01 N, 0.02 N], spring: 2 N/m }]";
    let (wide, high) = (scene(TIP, 4e3), scene(device, 4e3));
    let pattern = random_on(wide.membrane().raster, 3);
    let transpose = Symmetry::ALL
        .into_iter()
        .find(|g| g.matrix() == [[0, 1], [1, 0]])
        .unwrap();
    let solve = |scene: &Scene, pattern: &Pattern| {
        let solver = solver_of(scene, Mesh::bilinear(2));
        solver.field(&solver.solve(pattern))
    };
    let field = solve(&wide, &pattern);
    let image = solve(&high, &pattern.transformed(transpose));
    assert!(field.max_magnitude() > 0.05);
    assert!(image.rms_difference(&field.transformed(transpose)) < 1e-8);
    for (geometry, count) in [(DISC, 8), (HUB, 2), (TIP, 1), (ROTORS, 1)] {
        assert_eq!(scene(geometry, 0.0).symmetries().count(), count, "{geometry}");
    }
    let hub = scene(HUB, 4e3);
    let pattern = random_on(hub.membrane().raster, 5);
    let field = solve(&hub, &pattern);
    for g in hub.symmetries().iter() {
        assert!(solve(&hub, &pattern.transformed(g)).rms_difference(&field.transformed(g)) < 1e-8);
    }
}

#[test]
fn the_gradient_of_a_displacement_agrees_with_differences_beside_frames_and_bodies() {
    for geometry in [HUB, TIP, ROTORS] {
        let scene = scene(geometry, 4e3);
        let raster = scene.membrane().raster;
        let pattern = random_on(raster, 8);
        let mut weights = vec![0.0; 2 * raster.corners()];
        let corner = |x: usize, y: usize| 2 * (y * raster.corner_sides()[0] + x);
        weights[corner(20, 9)] = 1.0;
        weights[corner(6, 10) + 1] = -0.5;
        let weights = Field::from_values(raster, weights).unwrap();
        let mesh = Mesh::bilinear(2);
        let solver = MembraneSolver::new(&scene, SolveOptions { mesh, tolerance: 1e-12 }).unwrap();
        let membrane =
            (0..raster.cells()).filter(|at| solver.grid().is_membrane(at % raster.columns(), at / raster.columns()));
        check_gradient(&scene, &solver, &pattern, &weights, membrane.step_by(97));
    }
}

#[test]
fn paths_and_limits_of_devices_are_those_of_their_membranes() {
    // A frame with a square opening of half the side gives the membrane of that square.
    let framed = scene(
        "side: 50 mm, prestretch: 3, cells: 20, frame: { opening: { rectangle: [[10 mm, 15 mm], [35 mm, 40 mm]] } }",
        12e3,
    );
    let small = scene("side: 25 mm, prestretch: 3, cells: 10", 12e3);
    let inside = random_on(small.membrane().raster, 4);
    let pattern = Pattern::from_fn(framed.membrane().raster, |x, y| {
        (4..14).contains(&x) && (6..16).contains(&y) && inside.is_active(x - 4, y - 6)
    });
    let mesh = Mesh::biquadratic(1);
    let [a, b] = [(&framed, &pattern), (&small, &inside)].map(|(scene, pattern)| {
        let solver = solver_of(scene, mesh);
        let limit = solver.path(pattern).unwrap().limit().unwrap();
        let [low, high] = solver.solve(pattern).outcome.bracket().unwrap();
        assert!((low * 0.999..high * 1.001).contains(&limit.voltage));
        (limit.kind, limit.voltage)
    });
    assert!(a.0 == b.0 && (a.1 / b.1 - 1.0).abs() < 1e-4, "{a:?} {b:?}");
}

#[test]
fn a_body_with_frame_all_around_it_moves() {
    let geometry = "side: 20 mm, prestretch: 3, cells: 10, bodies: [{ rectangle: [[2 mm, 2 mm], [18 mm, 18 mm]] }]";
    let scene = scene(geometry, 2000.0);
    let pattern = Pattern::from_fn(scene.membrane().raster, |x, _| x == 0);
    let moved = [Mesh::bilinear(1), Mesh::bilinear(3), Mesh::biquadratic(2)].map(|mesh| {
        let solver = solver_of(&scene, mesh);
        let solution = solver.solve(&pattern);
        assert!(solution.outcome.is_converged(), "{mesh:?}: {}", solution.outcome);
        let motion = solver.grid().motions(&solution.displacement).unwrap()[0];
        let [x, y] = motion.translation;
        assert!(y.abs() < 1e-9 * x && motion.rotation.abs() < 1e-9, "{mesh:?}: {x} {y}");
        x
    });
    // With one element per cell only the body is free.
    assert!(moved[0] > 0.0 && (moved[0] / moved[2] - 1.0).abs() < 0.2, "{moved:?}");
    assert!((moved[1] / moved[2] - 1.0).abs() < 0.02, "{moved:?}");
}
