//! Constrained nodes: those fixed by a frame, and those of rigid bodies, which move as t + (R(θ) − I)(X − Xc).
//!
//! The rigid motion of a body is stored as displacements of its nodes, so vectors have the same length with and without
//! bodies. A change of it is in the span of three vectors, the columns of T: two translations, and the rotation J R (X
//! − Xc) with the quarter turn J. Nodal forces f act on the body as Tᵀf; they are stored as T(TᵀT)⁻¹Tᵀf, which has the
//! same products with rigid changes. So conjugate gradients and norms need no special case. Elements inside a body
//! rotate with it: neither their energy, which is that of bare membrane, nor the forces on the body depend on the
//! rotation.

use super::grid::Grid;
use super::lanes::Real;
use super::layout::NodeLayout;
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
}

/// A rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct Rigid {
    /// All its nodes.
    pub nodes: RigidNodes,
    /// Those that share an element with a node that does not belong to the body.
    pub edge: RigidNodes,
    /// The forces on it.
    pub mount: Mount,
}

/// Nodes with one rigid motion.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidNodes {
    /// Offset from one component to the other.
    plane: usize,
    /// Indices of the nodes, for the first component.
    places: Vec<usize>,
    /// X − Xc of each, with the centroid Xc of the cells of the body.
    arms: Vec<[f64; 2]>,
}

/// The pose of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// t, of the centroid.
    pub translation: [f64; 2],
    /// cos θ and sin θ.
    pub turn: [f64; 2],
}

impl Pose {
    /// The pose at rest.
    pub const REST: Self = Self {
        translation: [0.0; 2],
        turn: [1.0, 0.0],
    };

    /// Returns θ in radians, −π to π, counterclockwise.
    #[must_use]
    pub fn angle(&self) -> f64 {
        self.turn[1].atan2(self.turn[0])
    }

    /// Returns the pose half-way between two: the mean translation, and half of the rotation. The motion from the first
    /// to the last is in the span of T there.
    #[must_use]
    pub fn between(first: &Self, last: &Self) -> Self {
        let middle = |a: [f64; 2], b: [f64; 2]| [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
        let [c, s] = middle(first.turn, last.turn);
        let size = c.hypot(s);
        Self {
            translation: middle(first.translation, last.translation),
            turn: if size > 0.0 { [c / size, s / size] } else { first.turn },
        }
    }

    /// Returns R a.
    #[must_use]
    pub fn turned(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [c, s] = self.turn;
        [c * x - s * y, s * x + c * y]
    }

    /// Returns J R a, the change of a per radian.
    #[must_use]
    pub fn swept(&self, arm: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.turned(arm);
        [-y, x]
    }
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
        supports
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

    /// Corrects a displacement so that the motion of every body is rigid, as needed after a step along the tangent.
    pub fn settle<T: Real>(&self, u: &mut [T]) {
        for body in &self.bodies {
            body.nodes.place(&body.nodes.pose(u), u);
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

    /// Projects a vector onto admissible changes: zero at fixed nodes, rigid on bodies.
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
    }

    /// Returns the dimensionless energy of forces and springs at some poses.
    #[must_use]
    pub fn energy(&self, poses: &[Pose]) -> f64 {
        let each = self.bodies.iter().zip(poses);
        let each = each.map(|(body, pose)| body.mount.energy(pose.translation, pose.turned(body.mount.arm), 1.0));
        each.sum()
    }
}

impl Rigid {
    /// Returns its own mass along x and y and its moment of inertia, in addition to those of the membrane in its place:
    /// those of a uniform bar, which alone has one; 0 for motions that it does not make.
    #[must_use]
    pub fn own_masses(&self) -> [f64; 3] {
        let mass = self.mount.mass;
        let squares = self.nodes.arms.iter().map(|[x, y]| x * x + y * y);
        // The arms of the ends are half of the length.
        let moment = mass * squares.fold(0.0, f64::max) / 3.0;
        let masses = [mass, mass, moment];
        std::array::from_fn(|at| if self.mount.moves[at] { masses[at] } else { 0.0 })
    }

    /// Returns (TᵀT)⁻¹ times a force and moment, for the motions that the body makes.
    #[must_use]
    pub fn motion(&self, pose: &Pose, force: [f64; 3]) -> [f64; 3] {
        self.nodes.motion_in(pose, force, self.mount.moves)
    }
}

impl RigidNodes {
    fn none(plane: usize) -> Self {
        Self {
            plane,
            places: Vec::new(),
            arms: Vec::new(),
        }
    }

    fn push(&mut self, place: usize, arm: [f64; 2]) {
        self.places.push(place);
        self.arms.push(arm);
    }

    /// Returns their number.
    #[must_use]
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Returns their indices and arms.
    pub fn iter(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        self.places.iter().copied().zip(self.arms.iter().copied())
    }

    /// Returns the pose that fits their displacements best.
    fn pose<T: Real>(&self, u: &[T]) -> Pose {
        let (count, plane) = (self.len() as f64, self.plane);
        let (mut arm, mut shift) = ([0.0; 2], [0.0; 2]);
        for (at, [x, y]) in self.iter() {
            arm = [arm[0] + x, arm[1] + y];
            shift = [shift[0] + u[at].to_f64(), shift[1] + u[at + plane].to_f64()];
        }
        let (arm, shift) = (arm.map(|sum| sum / count), shift.map(|sum| sum / count));
        let (mut along, mut across) = (0.0, 0.0);
        for (at, [x, y]) in self.iter() {
            let [a, b] = [x - arm[0], y - arm[1]];
            let [p, q] = [a + u[at].to_f64() - shift[0], b + u[at + plane].to_f64() - shift[1]];
            along += a * p + b * q;
            across += a * q - b * p;
        }
        let size = along.hypot(across);
        let turn = if size > 0.0 {
            [along / size, across / size]
        } else {
            Pose::REST.turn
        };
        let pose = Pose {
            translation: [0.0; 2],
            turn,
        };
        let turned = pose.turned(arm);
        Pose {
            translation: [arm[0] + shift[0] - turned[0], arm[1] + shift[1] - turned[1]],
            turn,
        }
    }

    /// Writes the displacements of a pose.
    pub fn place<T: Real>(&self, pose: &Pose, u: &mut [T]) {
        for (at, arm) in self.iter() {
            let turned = pose.turned(arm);
            u[at] = T::from_f64(pose.translation[0] + turned[0] - arm[0]);
            u[at + self.plane] = T::from_f64(pose.translation[1] + turned[1] - arm[1]);
        }
    }

    /// Returns Tᵀf: force and moment about the centroid.
    #[must_use]
    pub fn force<T: Real>(&self, pose: &Pose, vector: &[T]) -> [f64; 3] {
        let (mut force, plane) = ([0.0; 3], self.plane);
        for (at, arm) in self.iter() {
            let ([p, q], [x, y]) = ([vector[at].to_f64(), vector[at + plane].to_f64()], pose.swept(arm));
            force = [force[0] + p, force[1] + q, force[2] + x * p + y * q];
        }
        force
    }

    /// Returns the curvature of the rotation, −Σ R(X − Xc) · f: the decrease of the moment of nodal forces with the
    /// angle.
    #[must_use]
    pub fn curvature(&self, pose: &Pose, forces: &[f64]) -> f64 {
        let each = self.iter().map(|(at, arm)| {
            let [x, y] = pose.turned(arm);
            x * forces[at] + y * forces[at + self.plane]
        });
        -each.sum::<f64>()
    }

    /// Returns (TᵀT)⁻¹ times a force and moment.
    #[must_use]
    pub fn motion(&self, pose: &Pose, force: [f64; 3]) -> [f64; 3] {
        self.motion_in(pose, force, [true; 3])
    }

    /// Like [`Self::motion`], where only some motions are free.
    fn motion_in(&self, pose: &Pose, force: [f64; 3], moves: [bool; 3]) -> [f64; 3] {
        let count = self.len() as f64;
        let (mut sum, mut square) = ([0.0; 2], 0.0);
        for &arm in &self.arms {
            let [x, y] = pose.swept(arm);
            sum = [sum[0] + x, sum[1] + y];
            square += x * x + y * y;
        }
        let only = |at: usize, value: f64| if moves[at] { value } else { 0.0 };
        let [p, q] = [0, 1].map(|c| only(c, force[c]));
        let [x, y] = [0, 1].map(|c| only(c, sum[c] / count));
        let turn = only(2, (force[2] - x * p - y * q) / (square - count * (x * x + y * y)));
        [p / count - x * turn, q / count - y * turn, turn]
    }

    /// Writes T d.
    pub fn write<T: Real>(&self, pose: &Pose, [p, q, turn]: [f64; 3], vector: &mut [T]) {
        for (at, arm) in self.iter() {
            let [x, y] = pose.swept(arm);
            vector[at] = T::from_f64(p + turn * x);
            vector[at + self.plane] = T::from_f64(q + turn * y);
        }
    }

    /// Writes a force and moment as nodal forces.
    pub fn spread<T: Real>(&self, pose: &Pose, force: [f64; 3], vector: &mut [T]) {
        self.write(pose, self.motion(pose, force), vector);
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
