//! The discrete operators against each other, against differences, and on fields that they must reproduce.

use super::*;
use crate::fem::element::{Bilinear, Biquadratic, Element};
use crate::fem::kinematics::deformation;

#[test]
fn residual_and_tangent_are_derivatives_of_the_energy() {
    for order in [Order::Bilinear, Order::Biquadratic] {
        let mesh = Mesh::new(1, order);
        let material = NeoHookean::new(3.0, 0.0255);
        let activity = Activity::new(mesh, &random(4));
        let operator = Operator {
            mesh,
            material: &material,
            activity: &activity,
        };
        let wave = |phase: f64, size: f64| {
            let mut v: Vec<f64> = (0..mesh.vector_len())
                .map(|i| size * (i as f64 * 0.61 + phase).sin())
                .collect();
            mesh.clear_frame(&mut v);
            v
        };
        let (u, du, step) = (wave(0.0, 0.1), wave(2.0, 1.0), 1e-5);
        let moved = |by: f64| u.iter().zip(&du).map(|(u, d)| u + by * d).collect::<Vec<_>>();
        let mut r = vec![0.0; mesh.vector_len()];
        assert!(operator.residual(&u, &mut r) > 0.0);
        let slope = (energy(&operator, &moved(step)) - energy(&operator, &moved(-step))) / (2.0 * step);
        let work: f64 = r.iter().zip(&du).map(|(r, d)| r * d).sum();
        assert!((slope / work - 1.0).abs() < 1e-6, "{slope} {work}");
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
    }
}

/// The total energy in units of μH times the area of an element.
fn energy<L: Material>(operator: &Operator<'_, L>, u: &[f64]) -> f64 {
    match operator.mesh.order() {
        Order::Bilinear => energy_of::<Bilinear, L, 4>(operator, u),
        Order::Biquadratic => energy_of::<Biquadratic, L, 9>(operator, u),
    }
}

fn energy_of<E: Element<N>, L: Material, const N: usize>(operator: &Operator<'_, L>, u: &[f64]) -> f64 {
    let (mesh, side) = (operator.mesh, E::DEGREE + 1);
    let element = |row: usize, column: usize| -> f64 {
        let nodal = std::array::from_fn(|c| {
            std::array::from_fn(|node| {
                u[mesh.index(c, column * E::DEGREE + node % side, row * E::DEGREE + node / side)]
            })
        });
        let active = operator.activity.elements()[row * mesh.part() + column];
        let densities = E::gradients(&nodal).map(|gradient| operator.material.energy(deformation(gradient), active));
        densities
            .iter()
            .zip(E::WEIGHTS)
            .map(|(density, weight)| density * weight)
            .sum()
    };
    let n = mesh.elements();
    (0..n * n).map(|i| element(i / n, i % n)).sum()
}

#[test]
fn affine_displacements_of_a_uniform_membrane_are_in_equilibrium() {
    for order in [Order::Bilinear, Order::Biquadratic] {
        let mesh = Mesh::new(1, order);
        let material = NeoHookean::new(2.0, 0.05);
        let activity = Activity::new(mesh, &Pattern::from_fn(|_, _| true));
        let operator = Operator {
            mesh,
            material: &material,
            activity: &activity,
        };
        let mut u = vec![0.0; mesh.vector_len()];
        for (row, column) in places(mesh) {
            let (x, y) = (column as f64, row as f64);
            u[mesh.index(0, column, row)] = 0.07 * x + 0.03 * y;
            u[mesh.index(1, column, row)] = -0.02 * x + 0.05 * y;
        }
        let mut r = vec![0.0; mesh.vector_len()];
        operator.residual(&u, &mut r);
        assert!(norm(&r) < 1e-12);
    }
}

#[test]
fn conjugate_gradients_and_factors_find_the_same_solution() {
    let scene = Scene::vhb4910();
    let mesh = Mesh::new(1, Order::Bilinear);
    let material = NeoHookean::new(scene.prestretch(), scene.kappa());
    let activity = Activity::new(mesh, &random(5));
    let mut u = vec![0.0; mesh.vector_len()];
    newton_by_factors(
        &Operator {
            mesh,
            material: &material,
            activity: &activity,
        },
        &vec![0.0; mesh.vector_len()],
        &mut u,
    );
    let iterated = solver(&scene, 1).solve(&random(5)).displacement;
    let gap = iterated.iter().zip(&u).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(gap < 1e-9, "{gap:e}");
}
