//! Energies of rigid bodies, and the periods of their springs.

use std::f64::consts::TAU;

use crate::grid::Grid;
use crate::mass::Mass;
use crate::supports::Pose;
use deaflow_scene::Scene;

/// Returns the energy of the springs of bodies, and the work of their loads since rest, in J.
#[must_use]
pub fn energies(scene: &Scene, grid: &Grid, u: &[f64]) -> [f64; 2] {
    let motions = grid.motions(u).unwrap_or_default();
    let bodies = scene.geometry.bodies.iter().flatten().zip(motions);
    let each = bodies.map(|(body, motion)| {
        let [x, y] = motion.translation.map(|mm| 1e-3 * mm);
        let [along, across] = body.load_n();
        [0.5 * body.spring_n_per_m() * (x * x + y * y), along * x + across * y]
    });
    each.fold([0.0; 2], |sum, energies| [sum[0] + energies[0], sum[1] + energies[1]])
}

/// Returns the shortest period of a body on its spring, in the unit of time in which the mass per area is 1; `None`
/// without springs.
#[must_use]
pub fn shortest_period(grid: &Grid, mass: &Mass) -> Option<f64> {
    let supports = grid.supports()?;
    let len = grid.layout().vector_len();
    let period = |body: &crate::supports::Rigid| {
        let (mut along, mut image) = (vec![0.0; len], vec![0.0; len]);
        body.nodes.write(&Pose::REST, [1.0, 0.0, 0.0], &mut along);
        mass.apply(&along, &mut image);
        let [heavy, ..] = body.nodes.force(&Pose::REST, &image);
        TAU * (heavy / body.mount.spring).sqrt()
    };
    let sprung = supports.bodies().iter().filter(|body| body.mount.spring > 0.0);
    sprung.map(period).reduce(f64::min)
}
