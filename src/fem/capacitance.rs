//! The inverse Laplacian of a membrane with frames and bodies, from that of its bounding rectangle by the
//! capacitance-matrix method (Buzbee, Dorr, George and Golub, SIAM J. Numer. Anal. 8 (1971) 722; Proskurowski and
//! Widlund, Math. Comp. 30 (1976) 433).
//!
//! With the inverse A⁻¹ of the Laplacian of the rectangle the solution is A⁻¹(r + s). The forces s act on the nodes of
//! frames and bodies that share an element with free ones, such that the solution vanishes on frames and is rigid on
//! bodies, and s balances the force on each body. S, the inverse restricted to those nodes, is dense and small; its own
//! inverse is stored. Inside frames and bodies the solution is then correct, because zero and rigid motions are
//! harmonic. The number of conjugate-gradient iterations is that of the rectangle. The first solution is needed at
//! those few nodes only, as sums over its modes, so the total takes little more than one solution on the rectangle.

use std::sync::Arc;

use deaflow_linalg::{Mat, inverse_definite, solve};

use super::krylov::dot;
use super::rectangle::{ModalNodes, Rectangle, RectangleScratch};
use super::supports::{Pose, RigidNodes, Supports};

/// Largest number of nodes for which S⁻¹ is stored, which takes 10 MB and a second. Beyond it the solution on the
/// rectangle is projected onto admissible motions.
const MOST: usize = 1600;

/// Corrects the inverse of the rectangle to that of the membrane.
pub(super) struct Capacitance {
    supports: Arc<Supports>,
    correction: Option<Correction>,
}

/// Vectors for [`Capacitance::solve`].
pub(super) struct CapacitanceScratch {
    force: Vec<f32>,
    /// For each component at the nodes of S: values of the first solution, then forces.
    values: [Vec<f32>; 2],
    /// S⁻¹ of the values.
    images: [Vec<f32>; 2],
}

/// S⁻¹, and its products with rigid motions.
struct Correction {
    /// Nodes of frames, then those of each body.
    nodes: ModalNodes,
    /// `[node][node]`.
    inverse: Vec<f32>,
    /// S⁻¹ of 1, X and Y on the nodes of each body, `[body][function][node]`.
    rigid: Vec<[Vec<f64>; 3]>,
    /// Index of the first node of each body.
    starts: Vec<usize>,
}

impl Capacitance {
    pub(super) fn new(supports: Arc<Supports>, rectangle: &Rectangle) -> Self {
        let correction = Correction::new(&supports, rectangle);
        Self { supports, correction }
    }

    pub(super) fn scratch(&self) -> CapacitanceScratch {
        let nodes = self.correction.as_ref().map_or(0, |correction| correction.count());
        let zero = || [vec![0.0; nodes], vec![0.0; nodes]];
        CapacitanceScratch {
            force: vec![0.0; 2 * self.supports.plane()],
            values: zero(),
            images: zero(),
        }
    }

    /// Writes the solution for an admissible `r` into `z`.
    pub(super) fn solve(
        &self,
        rectangle: &Rectangle,
        r: &[f32],
        poses: &[Pose],
        z: &mut [f32],
        (scratch, own): (&mut RectangleScratch, &mut CapacitanceScratch),
    ) {
        let bodies = self.supports.bodies();
        own.force.copy_from_slice(r);
        let forces: Vec<[f64; 3]> = bodies
            .iter()
            .zip(poses)
            .map(|(body, pose)| {
                let force = body.nodes.force(pose, r);
                body.nodes.write(pose, [0.0; 3], &mut own.force);
                force
            })
            .collect();
        let motions = match &self.correction {
            Some(correction) => {
                let CapacitanceScratch { force, values, images } = own;
                let mut motions = Vec::new();
                rectangle.solve_corrected(force, &correction.nodes, z, (scratch, values), |values| {
                    motions = correction.correct(&self.supports, poses, &forces, values, images);
                });
                motions
            }
            None => {
                for ((body, pose), force) in bodies.iter().zip(poses).zip(&forces) {
                    body.edge.spread(pose, *force, &mut own.force);
                }
                rectangle.solve(&own.force, z, scratch);
                let average =
                    |(body, pose): (&super::supports::Rigid, &Pose)| body.edge.motion(pose, body.edge.force(pose, z));
                bodies.iter().zip(poses).map(average).collect()
            }
        };
        self.supports.clear_held(z);
        for ((body, pose), motion) in bodies.iter().zip(poses).zip(motions) {
            body.nodes.write(pose, motion, z);
        }
    }
}

impl Correction {
    fn new(supports: &Supports, rectangle: &Rectangle) -> Option<Self> {
        let (mut indices, mut starts) = (supports.held_edge().to_vec(), Vec::new());
        for body in supports.bodies() {
            starts.push(indices.len());
            indices.extend(body.edge.iter().map(|(at, _)| at));
        }
        let count = indices.len();
        if count == 0 || count > MOST {
            return None;
        }
        let nodes = rectangle.nodes(&indices);
        let columns = rectangle.between(&nodes);
        let symmetric = Mat::from_fn(count, count, |i, k| 0.5 * (columns[(i, k)] + columns[(k, i)]));
        let inverse = inverse_definite(&symmetric)?;
        let rigid = supports.bodies().iter().zip(&starts).map(|(body, &start)| {
            [0, 1, 2].map(|function| {
                let image = |row: usize| -> f64 {
                    let nodes = body.edge.iter().enumerate();
                    nodes
                        .map(|(at, (_, [x, y]))| inverse[(row, start + at)] * [1.0, x, y][function])
                        .sum()
                };
                (0..count).map(image).collect()
            })
        });
        Some(Self {
            rigid: rigid.collect(),
            inverse: (0..count * count)
                .map(|at| inverse[(at / count, at % count)] as f32)
                .collect(),
            nodes,
            starts,
        })
    }

    /// Returns the number of nodes.
    fn count(&self) -> usize {
        self.inverse.len().isqrt()
    }

    /// Converts values of the solution on the rectangle to the forces of frames and bodies. Returns the motions of
    /// bodies.
    fn correct(
        &self,
        supports: &Supports,
        poses: &[Pose],
        forces: &[[f64; 3]],
        values: &mut [Vec<f32>; 2],
        images: &mut [Vec<f32>; 2],
    ) -> Vec<[f64; 3]> {
        for (values, images) in values.iter().zip(images.iter_mut()) {
            for (image, row) in images.iter_mut().zip(self.inverse.chunks_exact(values.len())) {
                *image = dot(row, values) as f32;
            }
        }
        let motions = self.motions(supports, poses, forces, images);
        for (values, images) in values.iter_mut().zip(images.iter()) {
            values.iter_mut().zip(images).for_each(|(force, image)| *force = -image);
        }
        for ((pose, rigid), motion) in poses.iter().zip(&self.rigid).zip(&motions) {
            for (weights, forces) in weights(pose, *motion).iter().zip(values.iter_mut()) {
                for (at, force) in forces.iter_mut().enumerate() {
                    let sum: f64 = weights
                        .iter()
                        .zip(rigid)
                        .map(|(weight, values)| weight * values[at])
                        .sum();
                    *force += sum as f32;
                }
            }
        }
        motions
    }

    /// Solves for the motions of bodies: (EᵀS⁻¹E + K) d = g + EᵀS⁻¹b with the rigid motions E, springs K and forces g.
    fn motions(
        &self,
        supports: &Supports,
        poses: &[Pose],
        forces: &[[f64; 3]],
        images: &[Vec<f32>; 2],
    ) -> Vec<[f64; 3]> {
        let bodies = supports.bodies();
        if bodies.is_empty() {
            return Vec::new();
        }
        let size = 3 * bodies.len();
        let unit = |at: usize| std::array::from_fn(|k| if k == at { 1.0 } else { 0.0 });
        // Eᵀ of nodal values, by component.
        let on_body = |body: usize, values: &dyn Fn(usize, usize) -> f64| -> [f64; 3] {
            let nodes: &RigidNodes = &bodies[body].edge;
            let mut sum = [0.0; 3];
            for (at, (_, arm)) in nodes.iter().enumerate() {
                let swept = poses[body].swept(arm);
                let [x, y] = [0, 1].map(|c| values(c, self.starts[body] + at));
                sum = [sum[0] + x, sum[1] + y, sum[2] + swept[0] * x + swept[1] * y];
            }
            sum
        };
        let mut matrix = Mat::<f64>::zeros(size, size);
        let mut right = vec![0.0; size];
        for (other, rigid) in self.rigid.iter().enumerate() {
            for motion in 0..3 {
                let weights = weights(&poses[other], unit(motion));
                let image = |c: usize, at: usize| weights[c].iter().zip(rigid).map(|(w, values)| w * values[at]).sum();
                for body in 0..bodies.len() {
                    for (k, value) in on_body(body, &image).into_iter().enumerate() {
                        matrix[(3 * body + k, 3 * other + motion)] = value;
                    }
                }
            }
        }
        for (body, force) in forces.iter().enumerate() {
            let own = on_body(body, &|c, at| f64::from(images[c][at]));
            for k in 0..3 {
                right[3 * body + k] = force[k] + own[k];
            }
            for k in 0..2 {
                matrix[(3 * body + k, 3 * body + k)] += bodies[body].mount.spring;
            }
        }
        let motions = solve(&matrix, &right);
        (0..bodies.len())
            .map(|body| std::array::from_fn(|k| motions[3 * body + k]))
            .collect()
    }
}

/// Returns a rigid motion as weights of 1, X and Y in each component.
fn weights(pose: &Pose, [p, q, turn]: [f64; 3]) -> [[f64; 3]; 2] {
    let ([a, b], [c, d]) = (pose.swept([1.0, 0.0]), pose.swept([0.0, 1.0]));
    [[p, turn * a, turn * c], [q, turn * b, turn * d]]
}
