//! The discrete operators against each other, finite differences, and fields that they must reproduce.

use super::*;
use crate::element::{Bilinear, Biquadratic, Element};

#[test]
fn residual_and_tangent_are_derivatives_of_the_energy() {
    for (sheet, order) in
        sheets().flat_map(|sheet| [Order::Bilinear, Order::Biquadratic].map(|order| (sheet.clone(), order)))
    {
        let grid = Grid::uniform(Mesh::new(1, order), &sheet);
        let layout = grid.layout();
        let (kappa, [along, across]) = (0.0255, sheet.prestretch);
        let material = AnyMaterial::from(NeoHookean::new((along * across).sqrt(), kappa));
        let activity = Activity::new(&grid, &random_on(sheet.raster(), 4));
        let operator = Operator::new(&material, &activity);
        let wave = |phase: f64, size: f64| {
            let mut v: Vec<f64> = (0..layout.vector_len())
                .map(|i| size * (i as f64 * 0.61 + phase).sin())
                .collect();
            layout.clear_frame(&mut v);
            v
        };
        let (u, du, step) = (wave(0.0, 0.03), wave(2.0, 1.0), 1e-5);
        let moved = |by: f64| u.iter().zip(&du).map(|(u, d)| u + by * d).collect::<Vec<_>>();
        let mut r = vec![0.0; layout.vector_len()];
        assert!(operator.residual(&u, &mut r) > 0.0);
        let energy = |u: &[f64]| energy(&sheet, &activity, kappa, u);
        let slope = (energy(&moved(step)) - energy(&moved(-step))) / (2.0 * step);
        let work: f64 = r.iter().zip(&du).map(|(r, d)| r * d).sum();
        assert!((slope / work - 1.0).abs() < 2e-6, "{sheet:?}: {slope} {work}");
        let (mut up, mut down, mut image) = (r.clone(), r.clone(), r.clone());
        operator.residual(&moved(step), &mut up);
        operator.residual(&moved(-step), &mut down);
        operator.tangent(&u, &du, &mut image);
        let difference: Vec<f64> = up
            .iter()
            .zip(&down)
            .zip(&image)
            .map(|((p, m), t)| (p - m) / (2.0 * step) - t)
            .collect();
        assert!(norm(&difference) < 1e-7 * norm(&image));
        // At rest the prestress of a membrane without voltage is in equilibrium.
        let (bare, zero) = (
            NeoHookean::new((along * across).sqrt(), 0.0),
            vec![0.0; layout.vector_len()],
        );
        let material = &bare;
        let operator = Operator::new(material, &activity);
        operator.residual(&zero, &mut r);
        assert!(r.iter().all(|force| force.abs() <= operator.rounding()));
    }
}

/// The total energy of the theory, ∫ W(FΛ) dX/(λ₁λ₂) with W = ½(tr FᵀF + J⁻² − 3) − ½κJ² at electrodes, in units of μH
/// and the area of an element.
pub fn energy(sheet: &Sheet, activity: &Activity, kappa: f64, u: &[f64]) -> f64 {
    match activity.grid().order() {
        Order::Bilinear => energy_of::<Bilinear, 4>(sheet, activity, kappa, u),
        Order::Biquadratic => energy_of::<Biquadratic, 9>(sheet, activity, kappa, u),
    }
}

fn energy_of<E: Element<N>, const N: usize>(sheet: &Sheet, activity: &Activity, kappa: f64, u: &[f64]) -> f64 {
    let (grid, layout, side) = (activity.grid(), activity.grid().layout(), E::DEGREE + 1);
    let [along, across] = sheet.prestretch;
    // Sides of an element in units of displacements.
    let [width, height] =
        [0, 1].map(|axis| sheet.membrane.size_mm[axis] / grid.elements()[axis] as f64 / grid.unit_mm());
    let density = |gradient: [[f64; 2]; 2], active: f64| {
        let [[a, b], [c, d]] = gradient.map(|row| [row[0] / width, row[1] / height]);
        let f = [[(1.0 + a) * along, b * across], [c * along, (1.0 + d) * across]];
        let area = f[0][0] * f[1][1] - f[0][1] * f[1][0];
        let squares: f64 = f.as_flattened().iter().map(|entry| entry * entry).sum();
        (0.5 * (squares + area.powi(-2) - 3.0) - 0.5 * active * kappa * area * area) / (along * across)
    };
    let element = |[column, row]: [usize; 2]| -> f64 {
        let nodal = std::array::from_fn(|c| {
            std::array::from_fn(|node| {
                u[layout.index(c, column * E::DEGREE + node % side, row * E::DEGREE + node / side)]
            })
        });
        let active = activity.elements()[row * layout.part() + column];
        let points = E::gradients(&nodal).into_iter().zip(E::WEIGHTS);
        points
            .map(|(gradient, weight)| weight * density(gradient, active))
            .sum()
    };
    layout.each_element().map(element).sum()
}

#[test]
fn affine_displacements_of_a_uniform_membrane_are_in_equilibrium() {
    for order in [Order::Bilinear, Order::Biquadratic] {
        let grid = Grid::paper(Mesh::new(1, order));
        let material = AnyMaterial::from(NeoHookean::new(2.0, 0.05));
        let activity = Activity::new(&grid, &Pattern::from_fn(Raster::PAPER, |_, _| true));
        let operator = Operator::new(&material, &activity);
        let mut u = vec![0.0; grid.layout().vector_len()];
        for (row, column) in places(&grid) {
            let (x, y) = (column as f64, row as f64);
            u[grid.layout().index(0, column, row)] = 0.07 * x + 0.03 * y;
            u[grid.layout().index(1, column, row)] = -0.02 * x + 0.05 * y;
        }
        let mut r = vec![0.0; grid.layout().vector_len()];
        operator.residual(&u, &mut r);
        assert!(norm(&r) < 1e-12);
    }
}

#[test]
fn conjugate_gradients_and_factors_find_the_same_solution() {
    let scene = Scene::vhb4910();
    let grid = Grid::paper(Mesh::new(1, Order::Bilinear));
    let material = AnyMaterial::from(NeoHookean::new(scene.mean_prestretch(), scene.kappa()));
    let activity = Activity::new(&grid, &random(5));
    let mut u = vec![0.0; grid.layout().vector_len()];
    newton_by_factors(
        &Operator::new(&material, &activity),
        &vec![0.0; grid.layout().vector_len()],
        &mut u,
    );
    let iterated = solver(&scene, 1).solve(&random(5)).displacement;
    let gap = iterated.iter().zip(&u).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(gap < 1e-9, "{gap:e}");
}
