//! What fixes the motions of a membrane as a whole that nothing resists.
//!
//! Where the loads along a translation or a turn are balanced, the energy does not depend on it. Of all such states the
//! one is taken whose mean displacement and mean turn are zero: Σ w u = 0 and Σ w J(X − X̄)·u = 0, with the quarter
//! turn J and the area w = ∫φ dX of each node, so that meshes agree. With these vectors as the columns of C, changes of
//! a displacement and residuals are projected onto {v: Cᵀv = 0}. The projected residual Cλ of an equilibrium is then
//! zero: the product of a rigid motion n with the true one is zero, and Cᵀn is not. So the tangent has no eigenvalue of
//! zero, and what it is needed for (steps, stability, gradients) is the same as with supports.

use deaflow_linalg::{Mat, solve};

use super::element::{Bilinear, Biquadratic, Element};
use super::error::SetupError;
use super::grid::Grid;
use super::lanes::Real;
use super::rigid::{Pose, Rigid};
use super::sheet::SheetSides;
use deaflow_field::Order;
use deaflow_scene::{Edge, Floating, Pivot, Scene};

/// Refuses what is not simulated of a membrane with motions as a whole that nothing resists.
///
/// # Errors
/// If it has any.
pub fn check_resisted(scene: &Scene, with: &'static str) -> Result<(), SetupError> {
    match scene.geometry.floating().description() {
        Some(why) => Err(SetupError::Floating { why, with }),
        None => Ok(()),
    }
}

/// The conditions that fix the motions of the whole membrane.
#[derive(Clone, Debug, PartialEq)]
pub struct Gauge {
    /// Offset from one component to the other.
    plane: usize,
    along: [bool; 2],
    turn: Option<Centre>,
    /// Whether a node has this index, for the first component: others are padding.
    is_node: Vec<bool>,
    /// w of each node in units of their mean; zero in the padding.
    weights: Vec<f64>,
    /// X − X̄ of each.
    arms: Vec<[f64; 2]>,
    /// Σ w.
    total: f64,
    /// The columns of C: of translations, then of the turn.
    conditions: Vec<Vec<f64>>,
    /// The rigid motions in the mount, in the same order.
    motions: Vec<Vec<f64>>,
    /// Products of conditions with conditions, and of conditions with motions, without the nodes of bodies.
    products: [Mat<f64>; 2],
}

/// What the membrane turns about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Centre {
    /// Its middle.
    Middle,
    /// The centroid of a body, or the middle of a bar, by its number among the bodies.
    Body(usize),
}

impl Gauge {
    /// Creates the conditions for a grid with these bodies; the bars of sides are those after `drawn` others. `None` if
    /// all motions are resisted.
    pub fn new(grid: &Grid, bodies: &[Rigid], drawn: usize) -> Option<Self> {
        let sides = grid.sheet_sides().filter(|sides| !sides.floating.is_none())?;
        let plane = grid.layout().vector_len() / 2;
        let mut weights = match grid.order() {
            Order::Bilinear => areas::<Bilinear, 4>(grid, plane),
            Order::Biquadratic => areas::<Biquadratic, 9>(grid, plane),
        };
        let [columns, rows] = grid.layout().nodes();
        let mean = weights.iter().sum::<f64>() / (columns * rows) as f64;
        weights.iter_mut().for_each(|weight| *weight /= mean);
        let (mut arms, mut is_node) = (vec![[0.0; 2]; plane], vec![false; plane]);
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            let at = grid.layout().index(0, column, row);
            (arms[at], is_node[at]) = (grid.node_position([column, row]), true);
        }
        let total: f64 = weights.iter().sum();
        let sum = |c: usize| -> f64 { weights.iter().zip(&arms).map(|(weight, at)| weight * at[c]).sum() };
        let [x, y] = [0, 1].map(|c| sum(c) / total);
        arms.iter_mut().for_each(|at| *at = [at[0] - x, at[1] - y]);
        let ones: Vec<f64> = is_node.iter().map(|is_node| f64::from(u8::from(*is_node))).collect();
        let [conditions, motions] = [&weights, &ones].map(|weights| rigid_motions(sides.floating, weights, &arms));
        let turn = sides.floating.turn.map(|pivot| match pivot {
            Pivot::Any => Centre::Middle,
            Pivot::Body(number) => Centre::Body(number),
            Pivot::Bar(edge) => Centre::Body(drawn + bars_before(sides, edge)),
        });
        Some(Self {
            plane,
            along: sides.floating.along,
            turn,
            is_node,
            products: [&conditions, &motions].map(|others| products(&conditions, others, bodies)),
            weights,
            arms,
            total,
            conditions,
            motions,
        })
    }

    /// Returns the conditions as vectors.
    pub fn conditions(&self) -> &[Vec<f64>] {
        &self.conditions
    }

    /// Returns for each condition a component, of these, by whose value it can be replaced: near the middle for a
    /// translation, far from it for a turn.
    pub fn pins(&self, components: &[usize]) -> Vec<usize> {
        let distance = |at: usize| {
            let [x, y] = self.arms[at % self.plane];
            x.hypot(y)
        };
        let nearest = |c: usize| {
            let own = components.iter().filter(move |at| *at / self.plane == c);
            own.min_by(|a, b| distance(**a).total_cmp(&distance(**b)))
        };
        let translations = (0..2).filter(|c| self.along[*c]).filter_map(nearest);
        let lever = |at: usize| {
            let [x, y] = self.arms[at % self.plane];
            if at / self.plane == 0 { y.abs() } else { x.abs() }
        };
        let farthest = components.iter().max_by(|a, b| lever(**a).total_cmp(&lever(**b)));
        translations.chain(self.turn.and(farthest)).copied().collect()
    }

    /// Projects an admissible vector onto those that fulfil the conditions.
    pub fn project<T: Real>(&self, bodies: &[Rigid], poses: &[Pose], vector: &mut [T]) {
        let matrix = self.with_bodies(&self.products[0], &self.conditions, bodies, poses);
        let factors = solve(&matrix, &along(&self.conditions, vector));
        subtract(&self.conditions, &factors, bodies, poses, vector);
    }

    /// Subtracts from admissible forces multiples of the conditions, so that they are in balance.
    pub fn balance<T: Real>(&self, bodies: &[Rigid], poses: &[Pose], forces: &mut [T]) {
        let matrix = self.with_bodies(&self.products[1], &self.motions, bodies, poses);
        let factors = solve(&matrix.transpose().to_owned(), &along(&self.motions, forces));
        subtract(&self.conditions, &factors, bodies, poses, forces);
    }

    /// Subtracts rigid motions from an admissible vector, so that it fulfils the conditions: the transpose of
    /// [`Self::balance`].
    pub fn centre<T: Real>(&self, bodies: &[Rigid], poses: &[Pose], vector: &mut [T]) {
        let matrix = self.with_bodies(&self.products[1], &self.motions, bodies, poses);
        let factors = solve(&matrix, &along(&self.conditions, vector));
        subtract(&self.motions, &factors, bodies, poses, vector);
    }

    /// Adds the products on the nodes of bodies, where vectors are projected onto rigid motions.
    fn with_bodies(&self, products: &Mat<f64>, others: &[Vec<f64>], bodies: &[Rigid], poses: &[Pose]) -> Mat<f64> {
        let mut matrix = products.clone();
        for (body, pose) in bodies.iter().zip(poses) {
            let forces: Vec<[f64; 3]> = self.conditions.iter().map(|c| body.nodes.force(pose, c)).collect();
            for (k, other) in others.iter().enumerate() {
                let motion = body.motion(pose, body.nodes.force(pose, other));
                for (i, force) in forces.iter().enumerate() {
                    matrix[(i, k)] += (0..3).map(|at| force[at] * motion[at]).sum::<f64>();
                }
            }
        }
        matrix
    }

    /// Moves the membrane as a whole so that its displacement, in which bodies are rigid, fulfils the conditions.
    pub fn settle<T: Real>(&self, bodies: &[Rigid], u: &mut [T]) {
        if let Some(centre) = self.turn {
            self.turn_back(centre, bodies, u);
        }
        for c in (0..2).filter(|c| self.along[*c]) {
            let mean = self.mean(c, u);
            let own = u[c * self.plane..].iter_mut().zip(&self.is_node);
            own.filter(|(_, is_node)| **is_node)
                .for_each(|(u, _)| *u = T::from_f64(u.to_f64() - mean));
        }
    }

    fn mean<T: Real>(&self, c: usize, u: &[T]) -> f64 {
        let own = u[c * self.plane..].iter().zip(&self.weights);
        own.map(|(u, weight)| weight * u.to_f64()).sum::<f64>() / self.total
    }

    fn turn_back<T: Real>(&self, centre: Centre, bodies: &[Rigid], u: &mut [T]) {
        let moved = |u: &[T], at: usize| [u[at].to_f64(), u[at + self.plane].to_f64()];
        let (mut along, mut across) = (0.0, 0.0);
        for (at, (weight, [x, y])) in self.weights.iter().zip(&self.arms).enumerate() {
            let [p, q] = moved(u, at);
            along += weight * (x * (x + p) + y * (y + q));
            across += weight * (x * q - y * p);
        }
        let angle = across.atan2(along);
        // The place that does not move, from the middle of the mount.
        let place = match centre {
            Centre::Middle => [0, 1].map(|c| self.mean(c, u)),
            Centre::Body(number) => {
                let body = &bodies[number].nodes;
                let [x, y] = body.pose(u).translation;
                let centroid = body
                    .iter()
                    .next()
                    .map_or([0.0; 2], |(at, arm)| [0, 1].map(|c| self.arms[at][c] - arm[c]));
                [x + centroid[0], y + centroid[1]]
            }
        };
        // R(−θ) − I.
        let (less, sine) = (-2.0 * (0.5 * angle).sin().powi(2), angle.sin());
        for (at, (is_node, [x, y])) in self.is_node.iter().zip(&self.arms).enumerate() {
            if *is_node {
                let [p, q] = moved(u, at);
                let [a, b] = [x + p - place[0], y + q - place[1]];
                u[at] = T::from_f64(p + less * a + sine * b);
                u[at + self.plane] = T::from_f64(q + less * b - sine * a);
            }
        }
    }
}

/// Returns the number of bars on the sides before one.
fn bars_before(sides: &SheetSides, edge: Edge) -> usize {
    let before = Edge::ALL
        .into_iter()
        .zip(&sides.bars)
        .take_while(|(other, _)| *other != edge);
    before.filter(|(_, bar)| bar.is_some()).count()
}

/// Returns ∫φ dX of each node.
fn areas<E: Element<N>, const N: usize>(grid: &Grid, plane: usize) -> Vec<f64> {
    let mut areas = vec![0.0; plane];
    for element in grid.each_element() {
        let (nodes, (factor, masses)) = (grid.nodes_of::<N>(element), grid.mass_of::<E, N>(element));
        for (node, masses) in nodes.iter().zip(masses) {
            areas[*node] += factor * masses.iter().sum::<f64>();
        }
    }
    areas
}

/// Returns rigid motions, each node of which is multiplied by a weight: translations, then the turn, of about their
/// size.
fn rigid_motions(floating: Floating, weights: &[f64], arms: &[[f64; 2]]) -> Vec<Vec<f64>> {
    let plane = weights.len();
    let translation = |c: usize| {
        let mut vector = vec![0.0; 2 * plane];
        vector[c * plane..][..plane].copy_from_slice(weights);
        vector
    };
    let each = || weights.iter().zip(arms);
    let turn = || {
        let square: f64 = each().map(|(weight, [x, y])| weight * (x * x + y * y)).sum();
        let radius = (square / weights.iter().sum::<f64>()).sqrt();
        let along = each().map(|(weight, [_, y])| -weight * y / radius);
        along
            .chain(each().map(|(weight, [x, _])| weight * x / radius))
            .collect()
    };
    let translations = (0..2).filter(|c| floating.along[*c]).map(translation);
    translations.chain(floating.turn.map(|_| turn())).collect()
}

/// Returns the products of conditions with other vectors, without the nodes of bodies.
fn products(conditions: &[Vec<f64>], others: &[Vec<f64>], bodies: &[Rigid]) -> Mat<f64> {
    let len = conditions.first().map_or(0, Vec::len);
    let mut is_free = vec![1.0; len];
    for at in bodies.iter().flat_map(|body| body.nodes.iter().map(|(at, _)| at)) {
        (is_free[at], is_free[at + len / 2]) = (0.0, 0.0);
    }
    Mat::from_fn(conditions.len(), others.len(), |i, k| {
        let pairs = conditions[i].iter().zip(&others[k]).zip(&is_free);
        pairs.map(|((a, b), is_free)| a * b * is_free).sum()
    })
}

/// Returns the products of vectors with another.
fn along<T: Real>(vectors: &[Vec<f64>], other: &[T]) -> Vec<f64> {
    let product = |vector: &Vec<f64>| vector.iter().zip(other).map(|(a, b)| a * b.to_f64()).sum();
    vectors.iter().map(product).collect()
}

/// Subtracts multiples of vectors, projected onto admissible ones, from an admissible vector.
fn subtract<T: Real>(vectors: &[Vec<f64>], factors: &[f64], bodies: &[Rigid], poses: &[Pose], from: &mut [T]) {
    for (vector, factor) in vectors.iter().zip(factors) {
        from.iter_mut()
            .zip(vector)
            .for_each(|(own, value)| *own = T::from_f64(own.to_f64() - factor * value));
    }
    for (body, pose) in bodies.iter().zip(poses) {
        body.nodes
            .write(pose, body.motion(pose, body.nodes.force(pose, from)), from);
    }
}
