//! Constrained nodes: those fixed by a frame, and those of rigid bodies, which move as t + (R(θ) − I)(X − Xc).
//!
//! The rigid motion of a body is stored as displacements of its nodes, so vectors have the same length with and without
//! bodies. A change of it is in the span of three vectors, the columns of T: two translations, and the rotation J R (X
//! − Xc) with the quarter turn J. Nodal forces f act on the body as Tᵀf; they are stored as T(TᵀT)⁻¹Tᵀf, which has the
//! same products with rigid changes. So conjugate gradients and norms need no special case. Elements inside a body
//! rotate with it: neither their energy, which is that of bare membrane, nor the forces on the body depend on the
//! rotation.

use super::gauge::Gauge;
use super::grid::Grid;
use super::lanes::Real;
use super::layout::NodeLayout;
use super::rigid::{Pose, Rigid, RigidNodes};
use super::sheet::{Mount, SheetSides};
use deaflow_pattern::Part;

/// The constrained nodes of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Supports {
    /// Offset from one component to the other.
    plane: usize,
    /// Indices of fixed nodes inside the rectangle, for the first component.
    held: Vec<usize>,
    bodies: Vec<Rigid>,
    /// Number of bodies that are not bars.
    drawn_bodies: usize,
    /// Those of `held` that share an element with a movable node.
    held_edge: Vec<usize>,
    /// What fixes motions of the whole that nothing resists, if there are any.
    gauge: Option<Gauge>,
}

impl Supports {
    /// Creates the supports of a grid. `centroids` are the exact ones of bodies in units of the grid; without them they
    /// are those of the cells. Bars of sides are the last bodies.
    #[must_use]
    pub fn new(grid: &Grid, centroids: Option<Vec<[f64; 2]>>, mounts: &[Mount]) -> Self {
        let layout = grid.layout();
        let bars: Vec<(usize, Mount)> = grid.sheet_sides().into_iter().flat_map(SheetSides::bars).collect();
        let owners = Owners::new(grid, mounts.len(), &bars);
        let mut supports = Self {
            plane: layout.vector_len() / 2,
            held: Vec::new(),
            held_edge: Vec::new(),
            bodies: Vec::new(),
            drawn_bodies: mounts.len(),
            gauge: None,
        };
        let mut centroids = centroids.unwrap_or_else(|| of_cells(grid));
        for (side, _) in &bars {
            let mut nodes = layout.side_nodes(*side);
            let ends = nodes
                .next()
                .zip(nodes.last())
                .map(|(a, b)| [a, b].map(|node| grid.node_position(node)));
            let [a, b] = ends.expect("a side has two nodes");
            centroids.push([0, 1].map(|c| 0.5 * (a[c] + b[c])));
        }
        for mount in mounts.iter().chain(bars.iter().map(|(_, bar)| bar)) {
            supports.bodies.push(Rigid {
                nodes: RigidNodes::none(supports.plane),
                edge: RigidNodes::none(supports.plane),
                mount: *mount,
            });
        }
        let [columns, rows] = layout.nodes();
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            let place = layout.index(0, column, row);
            match owners.of(column, row) {
                Owner::Free | Owner::Side => {}
                Owner::Frame => {
                    supports.held.push(place);
                    if owners.is_beside_other(column, row) {
                        supports.held_edge.push(place);
                    }
                }
                Owner::Body(body) => {
                    let [x, y] = grid.node_position([column, row]);
                    let (rigid, [cx, cy]) = (&mut supports.bodies[body], centroids[body]);
                    let arm = [x - cx, y - cy];
                    rigid.nodes.push(place, arm);
                    if owners.is_beside_other(column, row) {
                        rigid.edge.push(place, arm);
                    }
                }
            }
        }
        supports.gauge = Gauge::new(grid, &supports.bodies, supports.drawn_bodies);
        supports
    }

    /// Returns what fixes the motions of the whole membrane that nothing resists; `None` if all are resisted.
    #[must_use]
    pub fn gauge(&self) -> Option<&Gauge> {
        self.gauge.as_ref()
    }

    /// Returns the number of bodies that are not bars.
    #[must_use]
    pub fn drawn_bodies(&self) -> usize {
        self.drawn_bodies
    }

    /// Returns the bodies in their order, then the bars in that of the sides.
    #[must_use]
    pub fn bodies(&self) -> &[Rigid] {
        &self.bodies
    }

    /// Returns the offset from the first component of a node to the second.
    #[must_use]
    pub fn plane(&self) -> usize {
        self.plane
    }

    /// Sets fixed nodes to zero.
    pub fn clear_held<T: Real>(&self, vector: &mut [T]) {
        for &at in &self.held {
            vector[at] = T::default();
            vector[at + self.plane] = T::default();
        }
    }

    /// Returns the indices of fixed nodes that share an element with a movable node, for the first component.
    #[must_use]
    pub fn held_edge(&self) -> &[usize] {
        &self.held_edge
    }

    /// Returns whether a force acts on a body, or moves it by a given distance, so that the state of rest differs from
    /// that of the membrane.
    #[must_use]
    pub fn is_loaded(&self) -> bool {
        let is_loaded = |mount: &Mount| mount.load != [0.0; 2] || mount.given != [0.0; 2];
        self.bodies.iter().any(|body| is_loaded(&body.mount))
    }

    /// Returns whether a bar has a given motion.
    #[must_use]
    pub fn has_given_motions(&self) -> bool {
        self.bodies.iter().any(|body| body.mount.given != [0.0; 2])
    }

    /// Writes a share of the given motions of bars; they keep their rotation.
    pub fn give_motions(&self, share: f64, u: &mut [f64]) {
        for body in self.bodies.iter().filter(|body| body.mount.given != [0.0; 2]) {
            let pose = Pose {
                translation: body.mount.given.map(|by| share * by),
                ..body.nodes.pose(u)
            };
            body.nodes.place(&pose, u);
        }
    }

    /// Returns the poses of the bodies.
    #[must_use]
    pub fn poses<T: Real>(&self, u: &[T]) -> Vec<Pose> {
        self.bodies.iter().map(|body| body.nodes.pose(u)).collect()
    }

    /// Corrects a displacement so that the motion of every body is rigid, as needed after a step along the tangent, and
    /// fixes motions of the whole.
    pub fn settle<T: Real>(&self, u: &mut [T]) {
        for body in &self.bodies {
            body.nodes.place(&body.nodes.pose(u), u);
        }
        if let Some(gauge) = &self.gauge {
            gauge.settle(&self.bodies, u);
        }
    }

    /// Returns the poses half-way in a step from `u` by `change`.
    #[must_use]
    pub fn poses_between(&self, u: &[f64], change: &[f64]) -> Vec<Pose> {
        if self.bodies.is_empty() {
            return Vec::new();
        }
        let end: Vec<f64> = u.iter().zip(change).map(|(u, change)| u + change).collect();
        let pairs = self.poses(u).into_iter().zip(self.poses(&end));
        pairs.map(|(first, last)| Pose::between(&first, &last)).collect()
    }

    /// Corrects a change from `u` so that the motion of every body is rigid. It is computed from the change itself, so
    /// that a small one is not rounded like the displacement.
    pub fn settle_change(&self, u: &[f64], change: &mut [f64]) {
        let halfway = self.poses_between(u, change);
        for (body, middle) in self.bodies.iter().zip(halfway) {
            let motion = body.motion(&middle, body.nodes.force(&middle, change));
            let first = body.nodes.pose(u);
            // The rotation by Δt + 2 sin ½Δθ J Rₘ (X − Xc), with Rₘ half of it.
            let s = (0.5 * motion[2]).clamp(-1.0, 1.0);
            let c = (1.0 - s * s).sqrt();
            let [x, y] = first.turn;
            let turn = [c * x - s * y, s * x + c * y];
            body.nodes.write(&Pose { turn, ..first }, motion, change);
        }
    }

    /// Projects a vector onto admissible changes: zero at fixed nodes, rigid on bodies, without motions of the whole
    /// that nothing resists.
    pub fn restrict<T: Real>(&self, poses: &[Pose], vector: &mut [T]) {
        self.restrict_with(poses, vector, |_, force| force);
    }

    /// Like [`Self::restrict`]; `change` modifies the force on each body.
    pub fn restrict_with<T: Real>(
        &self,
        poses: &[Pose],
        vector: &mut [T],
        change: impl Fn(usize, [f64; 3]) -> [f64; 3],
    ) {
        self.clear_held(vector);
        for (number, (body, pose)) in self.bodies.iter().zip(poses).enumerate() {
            let force = change(number, body.nodes.force(pose, vector));
            body.nodes.write(pose, body.motion(pose, force), vector);
        }
        if let Some(gauge) = &self.gauge {
            gauge.project(&self.bodies, poses, vector);
        }
    }

    /// Projects nodal forces onto those of frames and bodies, and adds springs and a share of the loads.
    pub fn restrict_forces<T: Real>(&self, poses: &[Pose], share: f64, forces: &mut [T]) {
        self.restrict_with(poses, forces, |body, [x, y, moment]| {
            let (mount, [p, q]) = (self.bodies[body].mount, poses[body].translation);
            let (load, spring) = (mount.load.map(|load| share * load), mount.spring);
            let [a, b] = poses[body].swept(mount.arm);
            [
                x + spring[0] * p - load[0],
                y + spring[1] * q - load[1],
                moment - (a * load[0] + b * load[1]),
            ]
        });
    }

    /// Returns the curvature of the rotation of each body, from the forces of all elements and a share of the loads.
    #[must_use]
    pub fn curvatures(&self, poses: &[Pose], share: f64, forces: &[f64]) -> Vec<f64> {
        let of_body = |(body, pose): (&Rigid, &Pose)| {
            let [x, y] = pose.turned(body.mount.arm);
            let [p, q] = body.mount.load.map(|load| share * load);
            body.nodes.curvature(pose, forces) + x * p + y * q
        };
        self.bodies.iter().zip(poses).map(of_body).collect()
    }

    /// Projects the tangent product of `du` onto forces of frames and bodies, and adds springs and the curvatures of
    /// rotations.
    pub fn restrict_product<T: Real>(&self, poses: &[Pose], curvatures: &[f64], du: &[T], product: &mut [T]) {
        let each = self.bodies.iter().zip(poses).zip(curvatures);
        let own: Vec<[f64; 3]> = each
            .map(|((body, pose), curvature)| {
                let [p, q, turn] = body.motion(pose, body.nodes.force(pose, du));
                let [along, across] = body.mount.spring;
                [along * p, across * q, curvature * turn]
            })
            .collect();
        self.restrict_with(poses, product, |body, force| {
            std::array::from_fn(|at| force[at] + own[body][at])
        });
    }

    /// Returns the supports of heights: bodies translate alone, on springs of these rates.
    #[must_use]
    pub fn levelled(&self, springs: &[f64]) -> Self {
        let mut levelled = self.clone();
        for (body, spring) in levelled.bodies.iter_mut().zip(springs) {
            body.mount = Mount {
                spring: [*spring; 2],
                moves: [true, true, false],
                ..Mount::FREE
            };
        }
        levelled
    }

    /// Brings admissible forces in balance along the motions of the whole that nothing resists.
    pub fn balance<T: Real>(&self, poses: &[Pose], forces: &mut [T]) {
        if let Some(gauge) = &self.gauge {
            gauge.balance(&self.bodies, poses, forces);
        }
    }

    /// Subtracts such motions from an admissible vector, as [`Gauge::centre`] does.
    pub fn centre<T: Real>(&self, poses: &[Pose], vector: &mut [T]) {
        if let Some(gauge) = &self.gauge {
            gauge.centre(&self.bodies, poses, vector);
        }
    }

    /// Returns the dimensionless energy of forces and springs at some poses.
    #[must_use]
    pub fn energy(&self, poses: &[Pose]) -> f64 {
        let each = self.bodies.iter().zip(poses);
        let each = each.map(|(body, pose)| body.mount.energy(pose.translation, pose.turned(body.mount.arm), 1.0));
        each.sum()
    }
}

/// The part that a node belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Owner {
    /// Free membrane.
    Free,
    /// The frame.
    Frame,
    /// A side that is held.
    Side,
    /// A body.
    Body(usize),
}

/// The owners of nodes.
struct Owners {
    layout: NodeLayout,
    /// The owner of each node, row by row.
    of: Vec<Owner>,
}

impl Owners {
    /// A node of several elements belongs to the frame before bodies, and to bodies before the membrane. Bars, on these
    /// sides, are counted after so many bodies.
    fn new(grid: &Grid, bodies: usize, bars: &[(usize, Mount)]) -> Self {
        let layout = grid.layout();
        let [columns, rows] = layout.nodes();
        let mut owners = Self {
            layout,
            of: vec![Owner::Free; columns * rows],
        };
        let mut at = vec![0; layout.vector_len() / 2];
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            at[layout.index(0, column, row)] = row * columns + column;
        }
        for element in grid.each_element() {
            let owner = match grid.content(element).part {
                Part::Membrane => continue,
                Part::Frame => Owner::Frame,
                Part::Body(body) => Owner::Body(body),
            };
            for index in grid.own_nodes(element) {
                let of = &mut owners.of[at[index]];
                if *of != Owner::Frame {
                    *of = owner;
                }
            }
        }
        for (number, (side, _)) in bars.iter().enumerate() {
            for [column, row] in layout.side_nodes(*side) {
                owners.of[row * columns + column] = Owner::Body(bodies + number);
            }
        }
        // A component that a roller holds is cleared with those of held sides.
        let mut free = vec![1.0; layout.vector_len()];
        layout.clear_frame(&mut free);
        let [own, other] = [0, layout.vector_len() / 2];
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            let index = layout.index(0, column, row);
            if free[own + index] == 0.0 && free[other + index] == 0.0 {
                owners.of[row * columns + column] = Owner::Side;
            }
        }
        owners
    }

    /// Returns the owner of a node.
    fn of(&self, column: usize, row: usize) -> Owner {
        self.of[row * self.layout.nodes()[0] + column]
    }

    /// Returns whether a node shares an element with one of another owner. A body enclosed by a frame has an edge only
    /// next to it.
    fn is_beside_other(&self, column: usize, row: usize) -> bool {
        let (degree, own) = (self.layout.degree(), self.of(column, row));
        let range = |at: usize, count: usize| {
            let first = if at.is_multiple_of(degree) {
                at.saturating_sub(degree)
            } else {
                at - at % degree
            };
            first..=(at / degree * degree + degree).min(count - 1)
        };
        let [columns, rows] = self.layout.nodes();
        let across = range(row, rows);
        let along = range(column, columns);
        let mut around = across.flat_map(|row| along.clone().map(move |column| (column, row)));
        around.any(|(column, row)| {
            let is_fixed = |owner| matches!(owner, Owner::Frame | Owner::Side);
            let other = self.of(column, row);
            other != own && !(is_fixed(own) && is_fixed(other))
        })
    }
}

/// Returns the centroid of the cells of each body.
fn of_cells(grid: &Grid) -> Vec<[f64; 2]> {
    let Some(parts) = grid.parts() else {
        return Vec::new();
    };
    let step = grid.per_cell().map(|count| count * grid.layout().degree());
    let mut sums = vec![([0.0; 2], 0.0); parts.bodies()];
    let raster = parts.raster();
    for (x, y) in (0..raster.cells()).map(|at| (at % raster.columns(), at / raster.columns())) {
        if let Part::Body(body) = parts.at(x, y) {
            let [low, high] = [0, 1].map(|more| grid.node_position([(x + more) * step[0], (y + more) * step[1]]));
            let (sum, count) = &mut sums[body];
            *sum = [0, 1].map(|axis| sum[axis] + 0.5 * (low[axis] + high[axis]));
            *count += 1.0;
        }
    }
    sums.into_iter()
        .map(|(sum, count)| sum.map(|sum| sum / count))
        .collect()
}
