//! Orders of convergence, and errors on typical patterns.

use super::*;
use crate::grid::Grid;

#[test]
fn smooth_solutions_converge_with_the_order_of_the_elements() {
    for (order, expected) in [(Order::Bilinear, 2.0), (Order::Biquadratic, 3.0)] {
        // Cells that are not squares, and unequal prestretch; with 3 cells along a side the order is not yet
        // asymptotic.
        for sheet in sheets().filter(|sheet| sheet.raster().rows() > 3) {
            let errors = [1, 2].map(|per_cell| manufactured_error(Mesh::new(per_cell, order), &sheet));
            let slope = (errors[0] / errors[1]).log2();
            let room = if sheet == Sheet::paper() { 0.1 } else { 0.2 };
            assert!(
                (slope - expected).abs() < room,
                "{order:?}, {sheet:?}: {errors:?}, slope {slope}"
            );
        }
    }
}

#[test]
fn errors_on_patterns_are_those_that_labels_are_chosen_by() {
    // RMS in mm at κ = 0.0221 against a converged solution, measured with other codes: half pattern, bilinear with 1
    // and 2 elements per cell 2e-4 and 5e-5; random small grid 5.5e-3 and 1.4e-3, and biquadratic 7.5e-4 and 2e-4.
    let scene = Scene::vhb4910().at_voltage(5250.0 * (0.0221_f64 / 0.025489).sqrt());
    let run = |per_cell, order| {
        let solver = MembraneSolver::new(&scene, options(per_cell, order)).unwrap();
        let results = solver.simulate(&[half(), random(6)]);
        results
            .into_iter()
            .map(|result| result.field.unwrap())
            .collect::<Vec<Field>>()
    };
    let reference = run(4, Order::Biquadratic);
    for (per_cell, order, half_error, random_error) in [
        (1, Order::Bilinear, 2e-4, 5.5e-3),
        (2, Order::Bilinear, 5e-5, 1.4e-3),
        (1, Order::Biquadratic, 2e-5, 7.5e-4),
        (2, Order::Biquadratic, 2e-6, 2e-4),
    ] {
        let fields = run(per_cell, order);
        for (at, known) in [half_error, random_error].into_iter().enumerate() {
            let error = fields[at].rms_difference(&reference[at]);
            assert!(error < 1.5 * known, "{order:?} {per_cell}: {error:e}");
        }
    }
}

#[test]
fn every_mesh_comes_closer() {
    let run = |per_cell, order| {
        let solver = MembraneSolver::new(&Scene::vhb4910(), options(per_cell, order)).unwrap();
        solver.simulate(&[random(8)]).remove(0).field.unwrap()
    };
    let reference = run(5, Order::Biquadratic);
    for (order, finest) in [(Order::Bilinear, 8), (Order::Biquadratic, 3)] {
        let errors: Vec<f64> = (1..=finest).map(|n| run(n, order).rms_difference(&reference)).collect();
        assert!(errors.windows(2).all(|pair| pair[1] < 0.9 * pair[0]), "{errors:?}");
    }
}

/// The displacement of the manufactured solution and its gradient at a point of the unit square; lengths in units of
/// the side, or of the root of the area.
fn manufactured(x: f64, y: f64) -> ([f64; 2], [[f64; 2]; 2]) {
    use std::f64::consts::PI;
    let (sx, cx) = (PI * x).sin_cos();
    let (s2, c2) = (2.0 * PI * y).sin_cos();
    let (sy, cy) = (PI * y).sin_cos();
    let u = [0.03 * sx * s2, 0.04 * sx * sy];
    let gradient = [
        [0.03 * PI * cx * s2, 0.06 * PI * sx * c2],
        [0.04 * PI * cx * sy, 0.04 * PI * sx * cy],
    ];
    (u, gradient)
}

/// Rayleigh quotient of u = sin(πx)sin(πy) e₁ with the tangent at rest and the mass of the mesh, lengths in units of
/// the side.
fn rayleigh_quotient(mesh: Mesh, material: &AnyMaterial) -> f64 {
    let grid = Grid::paper(mesh);
    use std::f64::consts::PI;
    let activity = Activity::from_shares(&grid, |_, _| 1.0);
    let operator = Operator::new(material, &activity);
    let (mut mode, mut image) = (
        vec![0.0; grid.layout().vector_len()],
        vec![0.0; grid.layout().vector_len()],
    );
    let last = (grid.layout().nodes()[0] - 1) as f64;
    for (row, column) in places(&grid) {
        mode[grid.layout().index(0, column, row)] = (PI * column as f64 / last).sin() * (PI * row as f64 / last).sin();
    }
    grid.layout().clear_frame(&mut mode);
    operator.tangent(&vec![0.0; grid.layout().vector_len()], &mode, &mut image);
    let stiffness: f64 = mode.iter().zip(&image).map(|(u, f)| u * f).sum();
    let mut mass = 0.0;
    each_point(&grid, |_, weight, shapes| {
        let value: f64 = shapes
            .iter()
            .map(|s| s.2 * mode[grid.layout().index(0, s.0, s.1)])
            .sum();
        mass += weight * value * value;
    });
    stiffness * (grid.elements()[0] as f64).powi(2) / mass
}

#[test]
fn the_lowest_mode_about_rest_has_the_closed_form_frequency() {
    // H9: at κ = 3λ⁻⁸ exactly, f = (λ/2L)√(μ/ρ)√(m² + n²) = 216.50635 Hz for m = n = 1, μ = 25 kPa, ρ = 960 kg/m³, λ =
    // 3.
    let material = AnyMaterial::from(NeoHookean::new(3.0, 3.0 * 3.0_f64.powi(-8)));
    for (mesh, precision) in [
        (Mesh::new(2, Order::Bilinear), 2e-4),
        (Mesh::new(1, Order::Biquadratic), 1e-7),
    ] {
        let speed = 3.0 * (25e3_f64 / 960.0).sqrt();
        let frequency = rayleigh_quotient(mesh, &material).sqrt() * speed / 0.05 / (2.0 * std::f64::consts::PI);
        assert!((frequency / 216.50635 - 1.0).abs() < precision, "{frequency}");
    }
}

/// L² error of the solution under the load ∫ p(∇u) : ∇N of a smooth u, integrated by a finer rule.
fn manufactured_error(mesh: Mesh, sheet: &Sheet) -> f64 {
    let grid = Grid::uniform(mesh, sheet);
    let material = AnyMaterial::from(NeoHookean::new(2.0, 0.05));
    let activity = Activity::new(&grid, &Pattern::from_fn(sheet.raster(), |_, _| true));
    // The root of the area, and the sides, in units of displacements.
    let [width, height] = sheet.membrane.size_mm.map(|side| side / grid.unit_mm());
    let (length, rest) = ((width * height).sqrt(), grid.rest());
    let operator = Operator::new(&material, &activity);
    let mut load = vec![0.0; grid.layout().vector_len()];
    each_point(&grid, |place, weight, shapes| {
        let (_, [[a, b], [c, d]]) = manufactured(place[0], place[1]);
        let (x, y) = (length / width * rest[0], length / height * rest[1]);
        let gradient = [[a * x + rest[0] - 1.0, b * y], [c * x, d * y + rest[1] - 1.0]];
        let (p, sides) = (material.stress(gradient, 1.0), grid.sides([0, 0]));
        for &(column, row, _, slopes) in shapes {
            for c in 0..2 {
                let work = p[c][0] * slopes[0] / sides[0] + p[c][1] * slopes[1] / sides[1];
                load[grid.layout().index(c, column, row)] += weight * work;
            }
        }
    });
    grid.layout().clear_frame(&mut load);
    let mut u = vec![0.0; grid.layout().vector_len()];
    newton_by_factors(&operator, &load, &mut u);
    let mut error = 0.0;
    each_point(&grid, |place, weight, shapes| {
        let (exact, _) = manufactured(place[0], place[1]);
        for c in 0..2 {
            let value: f64 = shapes.iter().map(|s| s.2 * u[grid.layout().index(c, s.0, s.1)]).sum();
            error += weight * (value / length - exact[c]).powi(2);
        }
    });
    (error / grid.elements().iter().product::<usize>() as f64).sqrt()
}

/// Column, row, value and slopes of a basis function.
type Shape = (usize, usize, f64, [f64; 2]);

/// Calls `visit` with position, weight and basis functions at the points of a 5 × 5 Gauss rule on each element.
fn each_point(grid: &Grid, mut visit: impl FnMut([f64; 2], f64, &[Shape])) {
    // Abramowitz and Stegun, table 25.4, n = 5, on [−1, 1].
    let rule = [
        (0.0, 0.568_888_888_888_888_9),
        (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
        (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
        (0.906_179_845_938_664, 0.236_926_885_056_189_1),
        (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    ];
    let degree = grid.order().degree();
    let line = |x: f64| -> Vec<(f64, f64)> {
        match grid.order() {
            Order::Bilinear => vec![(1.0 - x, -1.0), (x, 1.0)],
            Order::Biquadratic => vec![
                ((1.0 - x) * (1.0 - 2.0 * x), 4.0 * x - 3.0),
                (4.0 * x * (1.0 - x), 4.0 - 8.0 * x),
                (x * (2.0 * x - 1.0), 4.0 * x - 1.0),
            ],
        }
    };
    let [columns, rows] = grid.elements();
    for [column, row] in grid.layout().each_element() {
        for ((gx, wx), (gy, wy)) in rule.iter().flat_map(|a| rule.iter().map(move |b| (*a, *b))) {
            let (x, y) = (0.5 + 0.5 * gx, 0.5 + 0.5 * gy);
            let (along, across) = (line(x), line(y));
            let shapes: Vec<Shape> = (0..(degree + 1).pow(2))
                .map(|i| (i % (degree + 1), i / (degree + 1)))
                .map(|(a, b)| {
                    let slopes = [along[a].1 * across[b].0, along[a].0 * across[b].1];
                    (column * degree + a, row * degree + b, along[a].0 * across[b].0, slopes)
                })
                .collect();
            let place = [(column as f64 + x) / columns as f64, (row as f64 + y) / rows as f64];
            visit(place, 0.25 * wx * wy, &shapes);
        }
    }
}
