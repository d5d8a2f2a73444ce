//! Rigid bodies and bars: their nodes, poses, and the forces on them.

use super::lanes::Real;
use super::sheet::Mount;

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
    /// Returns no nodes, of vectors with this offset from one component to the other.
    #[must_use]
    pub fn none(plane: usize) -> Self {
        Self {
            plane,
            places: Vec::new(),
            arms: Vec::new(),
        }
    }

    /// Adds a node.
    pub fn push(&mut self, place: usize, arm: [f64; 2]) {
        self.places.push(place);
        self.arms.push(arm);
    }

    /// Returns their number.
    #[must_use]
    pub fn count(&self) -> usize {
        self.places.len()
    }

    /// Returns their indices and arms.
    pub fn iter(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        self.places.iter().copied().zip(self.arms.iter().copied())
    }

    /// Returns the pose that fits their displacements best.
    #[must_use]
    pub fn pose<T: Real>(&self, u: &[T]) -> Pose {
        let (count, plane) = (self.count() as f64, self.plane);
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
        let count = self.count() as f64;
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
