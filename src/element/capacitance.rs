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
//!
//! With many such nodes, neighbours form clusters with equal forces, s = Zf, and conditions hold for their means: S⁻¹
//! becomes Z(ZᵀSZ)⁻¹Zᵀ. This is Galerkin's method for an integral equation of the first kind with piecewise constant
//! forces (Hsiao and Wendland, J. Math. Anal. Appl. 58 (1977) 449), so the number of iterations grows with the root of
//! the size of a cluster only.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use deaflow_linalg::{Mat, inverse_definite, solve};

use super::krylov::dot;
use super::rectangle::{ModalNodes, Rectangle, RectangleScratch};
use super::rigid::{Pose, Rigid};
use super::supports::Supports;

/// Number of nodes or clusters for which S⁻¹ is stored, which takes 10 MB and a second.
const MOST: usize = 1600;

/// Returns whether so many nodes of frames and bodies form clusters. Results then differ in their last digits from those
/// of earlier versions, which left the correction out.
pub fn is_clustered(nodes: usize) -> bool {
    nodes > MOST
}

/// Smallest number of clusters of a body with more nodes, so that its motion is determined.
const LEAST: usize = 16;

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
    /// Sums of the values over clusters, then forces on the nodes of each.
    sums: [Vec<f32>; 2],
    /// S⁻¹ of the sums.
    images: [Vec<f32>; 2],
}

/// S⁻¹, and its products with rigid motions.
struct Correction {
    /// Nodes of frames, then those of each body.
    nodes: ModalNodes,
    clusters: Clusters,
    /// For each component of the rectangle.
    inverses: Vec<Inverse>,
}

/// S⁻¹ for a component of vectors, or for both.
struct Inverse {
    /// `[cluster][cluster]`.
    entries: Vec<f32>,
    /// S⁻¹ of 1, X and Y on the nodes of each body, `[body][function][cluster]`.
    rigid: Vec<[Vec<f64>; 3]>,
}

/// Sets of neighbouring nodes with equal forces: single nodes if there are at most [`MOST`].
struct Clusters {
    /// The cluster of each node.
    of: Vec<usize>,
    /// Sums of 1, X and Y over the nodes of each cluster; of 1 only on frames.
    sums: Vec<[f64; 3]>,
    /// The clusters of each body.
    bodies: Vec<Range<usize>>,
}

/// A node of a frame or body.
#[derive(Clone, Copy)]
struct EdgeNode {
    /// Index for the first component.
    index: usize,
    /// X − Xc on bodies.
    arm: [f64; 2],
}

impl Clusters {
    /// Puts nodes, those of frames and then those of each body, into clusters.
    fn new(owners: &[Vec<EdgeNode>], place: impl Fn(usize) -> [usize; 2]) -> Self {
        let count = owners.iter().map(Vec::len).sum();
        let mut side = 1;
        let mut found = Self::in_blocks(owners, side, &place);
        while found.sums.len() > MOST && side < count {
            side += 1;
            found = Self::in_blocks(owners, side, &place);
        }
        found
    }

    /// Puts the nodes of each owner in the same block of `side` columns and rows into one cluster, with smaller blocks
    /// for bodies that would have too few.
    fn in_blocks(owners: &[Vec<EdgeNode>], side: usize, place: impl Fn(usize) -> [usize; 2]) -> Self {
        let mut clusters = Self {
            of: Vec::new(),
            sums: Vec::new(),
            bodies: Vec::new(),
        };
        for (owner, nodes) in owners.iter().enumerate() {
            let (first, is_body) = (clusters.sums.len(), owner > 0);
            let mut side = side;
            let blocks = loop {
                let blocks = nodes.iter().map(|node| place(node.index).map(|at| at / side));
                let blocks: Vec<[usize; 2]> = blocks.collect();
                let count = blocks.iter().collect::<BTreeSet<_>>().len();
                if !is_body || side == 1 || count >= LEAST {
                    break blocks;
                }
                side -= 1;
            };
            let mut numbers = BTreeMap::new();
            for (block, node) in blocks.into_iter().zip(nodes) {
                let cluster = *numbers.entry(block).or_insert_with(|| {
                    clusters.sums.push([0.0; 3]);
                    clusters.sums.len() - 1
                });
                clusters.of.push(cluster);
                let [x, y] = node.arm;
                let sum = &mut clusters.sums[cluster];
                *sum = [sum[0] + 1.0, sum[1] + x, sum[2] + y];
            }
            if is_body {
                clusters.bodies.push(first..clusters.sums.len());
            }
        }
        clusters
    }

    fn count(&self) -> usize {
        self.sums.len()
    }

    /// Adds up the values of nodes.
    fn sum(&self, values: &[Vec<f32>; 2], sums: &mut [Vec<f32>; 2]) {
        for (values, sums) in values.iter().zip(sums) {
            sums.fill(0.0);
            self.of.iter().zip(values).for_each(|(&at, value)| sums[at] += value);
        }
    }

    /// Copies forces to nodes.
    fn spread(&self, forces: &[Vec<f32>; 2], values: &mut [Vec<f32>; 2]) {
        for (forces, values) in forces.iter().zip(values) {
            self.of.iter().zip(values).for_each(|(&at, value)| *value = forces[at]);
        }
    }
}

impl Capacitance {
    pub(super) fn new(supports: Arc<Supports>, rectangle: &Rectangle) -> Self {
        let correction = Correction::new(&supports, rectangle);
        Self { supports, correction }
    }

    pub(super) fn scratch(&self) -> CapacitanceScratch {
        let clusters = self.correction.as_ref().map(|correction| &correction.clusters);
        let [nodes, clusters] = clusters.map_or([0; 2], |clusters| [clusters.of.len(), clusters.count()]);
        let zero = |count| [vec![0.0; count], vec![0.0; count]];
        CapacitanceScratch {
            force: vec![0.0; 2 * self.supports.plane()],
            values: zero(nodes),
            sums: zero(clusters),
            images: zero(clusters),
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
                let CapacitanceScratch {
                    force,
                    values,
                    sums,
                    images,
                } = own;
                let mut motions = Vec::new();
                rectangle.solve_corrected(force, &correction.nodes, z, (scratch, values), |values| {
                    correction.clusters.sum(values, sums);
                    motions = correction.correct(&self.supports, poses, &forces, sums, images);
                    correction.clusters.spread(sums, values);
                });
                motions
            }
            None => {
                for ((body, pose), force) in bodies.iter().zip(poses).zip(&forces) {
                    body.edge.spread(pose, *force, &mut own.force);
                }
                rectangle.solve(&own.force, z, scratch);
                let average = |(body, pose): (&Rigid, &Pose)| body.edge.motion(pose, body.edge.force(pose, z));
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
        let frames = supports.held_edge().iter();
        let mut owners: Vec<Vec<EdgeNode>> = vec![frames.map(|&index| EdgeNode { index, arm: [0.0; 2] }).collect()];
        owners.extend(supports.bodies().iter().map(|body| {
            let nodes = body.edge.iter();
            nodes.map(|(index, arm)| EdgeNode { index, arm }).collect()
        }));
        let clusters = Clusters::new(&owners, |index| rectangle.place(index));
        let count = clusters.count();
        if count == 0 {
            return None;
        }
        let indices: Vec<usize> = owners.concat().iter().map(|node| node.index).collect();
        let nodes = rectangle.nodes(&indices);
        let inverses = (0..rectangle.components()).map(|component| {
            let columns = match count == indices.len() {
                true => rectangle.between(component, &nodes),
                false => rectangle.between_clusters(component, &nodes, &clusters.of, count),
            };
            Inverse::new(&columns, &clusters)
        });
        Some(Self {
            inverses: inverses.collect::<Option<_>>()?,
            nodes,
            clusters,
        })
    }

    /// Returns S⁻¹ for a component of vectors.
    fn inverse(&self, c: usize) -> &Inverse {
        &self.inverses[c % self.inverses.len()]
    }

    /// Converts values of the solution on the rectangle, added up over clusters, to the forces of frames and bodies.
    /// Returns the motions of bodies.
    fn correct(
        &self,
        supports: &Supports,
        poses: &[Pose],
        forces: &[[f64; 3]],
        values: &mut [Vec<f32>; 2],
        images: &mut [Vec<f32>; 2],
    ) -> Vec<[f64; 3]> {
        for (c, (values, images)) in values.iter().zip(images.iter_mut()).enumerate() {
            for (image, row) in images
                .iter_mut()
                .zip(self.inverse(c).entries.chunks_exact(values.len()))
            {
                *image = dot(row, values) as f32;
            }
        }
        let motions = self.motions(supports, poses, forces, images);
        for (values, images) in values.iter_mut().zip(images.iter()) {
            values.iter_mut().zip(images).for_each(|(force, image)| *force = -image);
        }
        for (body, (pose, motion)) in poses.iter().zip(&motions).enumerate() {
            for (c, (weights, forces)) in weights(pose, *motion).iter().zip(values.iter_mut()).enumerate() {
                let rigid = &self.inverse(c).rigid[body];
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
        // Eᵀ of forces on clusters, by component.
        let on_body = |body: usize, values: &dyn Fn(usize, usize) -> f64| -> [f64; 3] {
            let mut total = [0.0; 3];
            for at in self.clusters.bodies[body].clone() {
                let [count, x, y] = self.clusters.sums[at];
                let swept = poses[body].swept([x, y]);
                let [p, q] = [0, 1].map(|c| values(c, at));
                total = [
                    total[0] + count * p,
                    total[1] + count * q,
                    total[2] + swept[0] * p + swept[1] * q,
                ];
            }
            total
        };
        let mut matrix = Mat::<f64>::zeros(size, size);
        let mut right = vec![0.0; size];
        for other in 0..bodies.len() {
            for motion in 0..3 {
                let weights = weights(&poses[other], unit(motion));
                let image = |c: usize, at: usize| {
                    let rigid = &self.inverse(c).rigid[other];
                    weights[c].iter().zip(rigid).map(|(w, values)| w * values[at]).sum()
                };
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
            for (k, rate) in bodies[body].mount.spring.into_iter().enumerate() {
                matrix[(3 * body + k, 3 * body + k)] += rate;
            }
            for at in (0..3)
                .filter(|at| !bodies[body].mount.moves[*at])
                .map(|at| 3 * body + at)
            {
                (0..size).for_each(|other| matrix[(at, other)] = 0.0);
                (matrix[(at, at)], right[at]) = (1.0, 0.0);
            }
        }
        let motions = solve(&matrix, &right);
        (0..bodies.len())
            .map(|body| std::array::from_fn(|k| motions[3 * body + k]))
            .collect()
    }
}

impl Inverse {
    /// Inverts sums of the inverse of the rectangle over clusters.
    fn new(columns: &Mat<f64>, clusters: &Clusters) -> Option<Self> {
        let count = clusters.count();
        let mut symmetric = Mat::zeros(count, count);
        for (i, k) in by_tiles(count) {
            symmetric[(i, k)] = 0.5 * (columns[(i, k)] + columns[(k, i)]);
        }
        // Nodes that a side holds do not move, so they need no force.
        for at in (0..count).filter(|at| columns[(*at, *at)] == 0.0) {
            symmetric[(at, at)] = 1.0;
        }
        let inverse = inverse_definite(&symmetric)?;
        let mut entries = vec![0.0; count * count];
        for (i, k) in by_tiles(count) {
            entries[i * count + k] = inverse[(i, k)] as f32;
        }
        let rigid = clusters.bodies.iter().map(|body| {
            [0, 1, 2].map(|function| {
                let image = |row: usize| -> f64 {
                    let own = body.clone();
                    own.map(|at| inverse[(row, at)] * clusters.sums[at][function]).sum()
                };
                (0..count).map(image).collect()
            })
        });
        Some(Self {
            rigid: rigid.collect(),
            entries,
        })
    }
}

/// Returns the places of a matrix by tiles, so that rows and columns of a tile stay in the cache.
fn by_tiles(count: usize) -> impl Iterator<Item = (usize, usize)> {
    const SIDE: usize = 32;
    let starts = move || (0..count).step_by(SIDE);
    let span = move |start: usize| start..(start + SIDE).min(count);
    let tiles = starts().flat_map(move |row| starts().map(move |column| (row, column)));
    tiles.flat_map(move |(row, column)| span(column).flat_map(move |k| span(row).map(move |i| (i, k))))
}

/// Returns a rigid motion as weights of 1, X and Y in each component.
fn weights(pose: &Pose, [p, q, turn]: [f64; 3]) -> [[f64; 3]; 2] {
    let ([a, b], [c, d]) = (pose.swept([1.0, 0.0]), pose.swept([0.0, 1.0]));
    [[p, turn * a, turn * c], [q, turn * b, turn * d]]
}
