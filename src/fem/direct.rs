//! The assembled and factorised tangent: for Newton steps where conjugate gradients fail, and to check stability.

use std::sync::Arc;

use deaflow_base::is_interrupted;
use deaflow_linalg::{Mat, Pair, SparseColMat, Sparsity, eigen, solve};

use super::boundary::cofactor_stress;
use super::eigenvalue::{add, dot};
use super::element::{Bilinear, Biquadratic, Element};
use super::grid::Grid;
use super::kinematics::{add_scaled, cofactor};
use super::laminate::excess_tangent;
use super::material::Material;
use super::memory;
use super::operator::Operator;
use super::rigid::{Pose, Rigid};
use super::supports::Supports;
use deaflow_field::Order;

/// The sparsity of the tangent and a fill-reducing order of the unknowns, the same for all tangents of a grid.
pub struct Structure {
    unknowns: Unknowns,
    sparsity: Sparsity,
    /// Unknowns on springs of stiffness 1, without which the matrix of a floating membrane is singular.
    pins: Vec<usize>,
}

impl Structure {
    /// Creates the structure of a grid; `None` if memory is short.
    pub fn new(grid: &Grid) -> Option<Arc<Self>> {
        let unknowns = Unknowns::new(grid);
        let at_rest = vec![Pose::REST; unknowns.bodies()];
        let mut pairs = Vec::new();
        let mut collect = |entry: MatrixEntry| pairs.push(Pair::new(entry.row, entry.column));
        match grid.layout().degree() {
            1 => unknowns.for_each_entry::<4>(&at_rest, |_, entries| entries.for_each(&mut collect)),
            _ => unknowns.for_each_entry::<9>(&at_rest, |_, entries| entries.for_each(&mut collect)),
        }
        let bodies = (0..3 * unknowns.bodies()).map(|at| unknowns.free.len() + at);
        pairs.extend(bodies.map(|at| Pair::new(at, at)));
        let pins = unknowns.pins();
        pairs.extend(pins.iter().map(|at| Pair::new(*at, *at)));
        let sparsity = Sparsity::new(unknowns.count(), &pairs)?;
        Some(Arc::new(Self {
            unknowns,
            sparsity,
            pins,
        }))
    }

    /// Adds the springs of pins to entries.
    fn with_pins(&self, mut entries: Vec<f64>, spring: f64) -> Vec<f64> {
        entries.extend(self.pins.iter().map(|_| spring));
        entries
    }

    /// Returns the entries of the tangent at `u`; those of bodies are last, before those of pins.
    fn entries<L: Material>(&self, operator: &Operator<'_, L>, u: &[f64]) -> Vec<f64> {
        let poses = operator.activity.grid().poses(u);
        let mut entries = match operator.activity.grid().order() {
            Order::Bilinear => assemble::<Bilinear, L, 4>(&self.unknowns, operator, u, &poses),
            Order::Biquadratic => assemble::<Biquadratic, L, 9>(&self.unknowns, operator, u, &poses),
        };
        if let Some(supports) = &self.unknowns.supports {
            for (body, curvature) in supports.bodies().iter().zip(operator.curvatures(u)) {
                // A motion that the body does not make keeps a pivot of its own.
                let [along, across] = body.mount.spring;
                let own = [along, across, curvature];
                entries.extend((0..3).map(|at| if body.mount.moves[at] { own[at] } else { 1.0 }));
            }
        }
        entries
    }

    /// Returns the tangent at `u` on and below the diagonal; `None` if memory is short.
    pub(super) fn tangent<L: Material>(
        &self,
        operator: &Operator<'_, L>,
        u: &[f64],
    ) -> Option<SparseColMat<usize, f64>> {
        self.sparsity.matrix(&self.with_pins(self.entries(operator, u), 0.0))
    }

    /// Returns the consistent mass of [`super::mass::Mass`] at `u`, which includes rotated bodies, on and below the
    /// diagonal; `None` if memory is short.
    pub(super) fn mass(&self, grid: &Grid, u: &[f64]) -> Option<SparseColMat<usize, f64>> {
        let poses = grid.poses(u);
        let mut entries = match grid.order() {
            Order::Bilinear => assemble_mass::<Bilinear, 4>(&self.unknowns, grid, &poses),
            Order::Biquadratic => assemble_mass::<Biquadratic, 9>(&self.unknowns, grid, &poses),
        };
        if let Some(supports) = &self.unknowns.supports {
            entries.extend(supports.bodies().iter().flat_map(Rigid::own_masses));
        }
        self.sparsity.matrix(&self.with_pins(entries, 0.0))
    }

    /// Converts nodal forces to forces on the unknowns at `u`.
    pub(super) fn pack(&self, grid: &Grid, u: &[f64], vector: &[f64]) -> Vec<f64> {
        self.unknowns.pack(&grid.poses(u), vector)
    }

    /// Converts unknowns to a change of displacement from `u`.
    pub(super) fn unpack(&self, grid: &Grid, u: &[f64], packed: &[f64]) -> Vec<f64> {
        self.unknowns.unpack(&grid.poses(u), packed)
    }

    /// Factorises the tangent at `u`; `None` if a pivot is exactly zero, memory is short, or the computation is
    /// interrupted.
    pub fn factorise<L: Material>(self: &Arc<Self>, operator: &Operator<'_, L>, u: &[f64]) -> Option<Factorisation> {
        if is_interrupted() {
            return None;
        }
        let entries = self.with_pins(self.entries(operator, u), PIN);
        let (values, poses) = (self.sparsity.factors(&entries)?, operator.activity.grid().poses(u));
        let border = match self.pins.is_empty() {
            true => None,
            false => Some(Border::new(self, &values, &poses)?),
        };
        Some(Factorisation {
            values,
            border,
            structure: Arc::clone(self),
            poses,
        })
    }

    /// Solves with factors of the matrix with pins.
    fn pinned(&self, values: &[f64], right: &[f64]) -> Vec<f64> {
        let mut solution = right.to_vec();
        self.sparsity.solve(values, &mut solution);
        solution
    }
}

/// The stiffness of the spring of a pin, about that of an element.
const PIN: f64 = 1.0;

/// The conditions C of a floating membrane, by which pins E are replaced: K z + C μ = r and Cᵀz = 0 with the tangent K
/// is the matrix K + EEᵀ with the border B = (C, E), and with 1 in place of 0 for E.
struct Border {
    /// The columns of B.
    columns: Vec<Vec<f64>>,
    /// (K + EEᵀ)⁻¹B.
    images: Vec<Vec<f64>>,
    /// The Schur complement of the border.
    complement: Mat<f64>,
    /// Its negative eigenvalues.
    negative: usize,
}

impl Border {
    /// Creates it from the factors of K + EEᵀ; `None` if the eigenvalues of the complement cannot be computed.
    fn new(structure: &Structure, values: &[f64], poses: &[Pose]) -> Option<Self> {
        let unknowns = &structure.unknowns;
        let gauge = unknowns.supports.as_ref()?.gauge()?;
        let conditions = gauge
            .conditions()
            .iter()
            .map(|condition| unknowns.pack(poses, condition));
        let pin = |at: &usize| {
            let mut column = vec![0.0; unknowns.count()];
            column[*at] = 1.0;
            column
        };
        let columns: Vec<Vec<f64>> = conditions.chain(structure.pins.iter().map(pin)).collect();
        let images: Vec<Vec<f64>> = columns.iter().map(|column| structure.pinned(values, column)).collect();
        let (count, conditions) = (columns.len(), gauge.conditions().len());
        let complement = Mat::from_fn(count, count, |i, k| {
            let own = if i == k && i >= conditions { 1.0 / PIN } else { 0.0 };
            own - 0.5 * (dot(&columns[i], &images[k]) + dot(&columns[k], &images[i]))
        });
        let eigenvalues = eigen(&complement)?.values;
        Some(Self {
            columns,
            images,
            complement,
            negative: eigenvalues.iter().filter(|value| **value < 0.0).count(),
        })
    }

    /// Corrects a solution with pins to one that fulfils the conditions.
    fn correct(&self, solution: &mut [f64]) {
        let forces: Vec<f64> = self.columns.iter().map(|column| -dot(column, solution)).collect();
        for (image, factor) in self.images.iter().zip(solve(&self.complement, &forces)) {
            add(solution, -factor, image);
        }
    }
}

/// LDLᵀ of the tangent at the interior nodes, in a fill-reducing order.
pub struct Factorisation {
    structure: Arc<Structure>,
    values: Vec<f64>,
    /// Of a floating membrane.
    border: Option<Border>,
    /// Poses of the bodies at the state of the tangent.
    poses: Vec<Pose>,
}

impl Factorisation {
    /// Factorises the tangent at `u`; `None` if a pivot is exactly zero or memory is short.
    #[cfg(test)]
    pub fn new<L: Material>(operator: &Operator<'_, L>, u: &[f64]) -> Option<Self> {
        Structure::new(operator.activity.grid())?.factorise(operator, u)
    }

    /// Returns the number of negative eigenvalues of the tangent.
    #[must_use]
    pub fn negative_pivots(&self) -> usize {
        let own = self.structure.sparsity.negative_pivots(&self.values);
        // By the inertia of the bordered matrix, in which each condition adds a negative eigenvalue.
        self.border.as_ref().map_or(own, |border| {
            (own + border.negative).saturating_sub(self.structure.pins.len())
        })
    }

    /// Solves with the factors. `r` is a residual, the result a displacement; both are zero on the frame.
    #[must_use]
    pub fn solve(&self, r: &[f64]) -> Vec<f64> {
        let unknowns = &self.structure.unknowns;
        let mut packed = self.structure.pinned(&self.values, &unknowns.pack(&self.poses, r));
        if let Some(border) = &self.border {
            border.correct(&mut packed);
        }
        unknowns.unpack(&self.poses, &packed)
    }
}

/// The unknowns of a grid: the components of each free node, row by row, then two translations and a rotation of each
/// body.
struct Unknowns {
    grid: Grid,
    supports: Option<Arc<Supports>>,
    /// Indices of the free components of nodes.
    free: Vec<usize>,
    /// Kind of each node, by its index.
    nodes: Vec<Node>,
}

#[derive(Clone, Copy)]
enum Node {
    /// Fixed by a frame.
    Fixed,
    /// Numbers of the unknowns of its components; those on rollers have one only.
    Free([Option<usize>; 2]),
    /// Body and arm of the node.
    Rigid(usize, [f64; 2]),
}

/// An entry of the tangent on or below the diagonal, to which a column of an element matrix adds one of its forces.
struct MatrixEntry {
    row: usize,
    column: usize,
    /// Index of the force of the element.
    force: usize,
    /// Factor of the force.
    weight: f64,
}

impl Unknowns {
    fn new(grid: &Grid) -> Self {
        let layout = grid.layout();
        let plane = layout.vector_len() / 2;
        let mut mask = vec![1.0; layout.vector_len()];
        layout.clear_frame(&mut mask);
        let supports = grid.shared_supports();
        let mut nodes = vec![Node::Fixed; plane];
        if let Some(supports) = &supports {
            supports.clear_held(&mut mask);
            for (number, body) in supports.bodies().iter().enumerate() {
                for (at, arm) in body.nodes.iter() {
                    (mask[at], mask[at + plane]) = (0.0, 0.0);
                    nodes[at] = Node::Rigid(number, arm);
                }
            }
        }
        let mut free = Vec::new();
        let [columns, rows] = layout.nodes();
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            let at = layout.index(0, column, row);
            let unknowns = [at, at + plane].map(|at| {
                let is_free = mask[at] == 1.0;
                is_free.then(|| {
                    free.push(at);
                    free.len() - 1
                })
            });
            if unknowns != [None; 2] {
                nodes[at] = Node::Free(unknowns);
            }
        }
        Self {
            grid: grid.clone(),
            supports,
            free,
            nodes,
        }
    }

    fn bodies(&self) -> usize {
        self.supports.as_ref().map_or(0, |supports| supports.bodies().len())
    }

    /// Returns as many unknowns as a floating membrane has motions, by which these can be fixed.
    fn pins(&self) -> Vec<usize> {
        let gauge = self.supports.as_ref().and_then(|supports| supports.gauge());
        let pinned = gauge.map_or_else(Vec::new, |gauge| gauge.pins(&self.free));
        let number = |index: usize| self.free.iter().position(|at| *at == index);
        pinned.into_iter().filter_map(number).collect()
    }

    fn count(&self) -> usize {
        self.free.len() + 3 * self.bodies()
    }

    /// Converts nodal forces to forces on the unknowns.
    fn pack(&self, poses: &[Pose], vector: &[f64]) -> Vec<f64> {
        let mut packed: Vec<f64> = self.free.iter().map(|&at| vector[at]).collect();
        if let Some(supports) = &self.supports {
            for (body, pose) in supports.bodies().iter().zip(poses) {
                let force = body.nodes.force(pose, vector);
                packed.extend((0..3).map(|at| if body.mount.moves[at] { force[at] } else { 0.0 }));
            }
        }
        packed
    }

    /// Converts unknowns to a change of displacement.
    fn unpack(&self, poses: &[Pose], packed: &[f64]) -> Vec<f64> {
        let plane = self.nodes.len();
        let mut vector = vec![0.0; 2 * plane];
        let (free, rigid) = packed.split_at(self.free.len());
        for (&at, value) in self.free.iter().zip(free) {
            vector[at] = *value;
        }
        if let Some(supports) = &self.supports {
            for ((body, pose), motion) in supports.bodies().iter().zip(poses).zip(rigid.chunks_exact(3)) {
                body.nodes.write(pose, [motion[0], motion[1], motion[2]], &mut vector);
            }
        }
        vector
    }

    /// Returns the unknowns that a component of a node, given its index for the first, depends on, with their weights.
    fn unknowns_of(&self, poses: &[Pose], c: usize, node: usize) -> impl Iterator<Item = (usize, f64)> + use<> {
        let terms = match self.nodes[node] {
            Node::Fixed => [None; 2],
            Node::Free(free) => [free[c].map(|unknown| (unknown, 1.0)), None],
            Node::Rigid(body, arm) => {
                let first = self.free.len() + 3 * body;
                let supports = self.supports.as_ref();
                let moves = supports.map_or([true; 3], |supports| supports.bodies()[body].mount.moves);
                [
                    moves[c].then_some((first + c, 1.0)),
                    moves[2].then(|| (first + 2, poses[body].swept(arm)[c])),
                ]
            }
        };
        terms.into_iter().flatten()
    }

    /// Visits the columns of the element matrices in the order of assembly. `visit` takes the element (column, row)
    /// with the component and node of the column, and the entries that it adds to.
    fn for_each_entry<const N: usize>(
        &self,
        poses: &[Pose],
        mut visit: impl FnMut(([usize; 2], usize, usize), &mut dyn Iterator<Item = MatrixEntry>),
    ) {
        let mut dependencies = Vec::new();
        for element in self.grid.each_element() {
            let nodes = self.grid.nodes_of::<N>(element);
            let of = |at: usize| {
                self.unknowns_of(poses, at / N, nodes[at % N])
                    .map(move |(unknown, weight)| (at, unknown, weight))
            };
            dependencies.clear();
            dependencies.extend((0..2 * N).flat_map(of));
            for at in 0..2 * N {
                let own = dependencies.iter().filter(|(of, ..)| *of == at);
                let mut entries = own.flat_map(|&(_, column, weight)| {
                    let below = dependencies.iter().filter(move |(_, row, _)| *row >= column);
                    below.map(move |&(force, row, own)| MatrixEntry {
                        row,
                        column,
                        force,
                        weight: weight * own,
                    })
                });
                visit((element, at / N, at % N), &mut entries);
            }
        }
    }
}

/// Returns the entries of the tangent in the order of [`Unknowns::for_each_entry`].
fn assemble<E: Element<N>, L: Material, const N: usize>(
    unknowns: &Unknowns,
    operator: &Operator<'_, L>,
    u: &[f64],
    poses: &[Pose],
) -> Vec<f64> {
    let (layout, grid) = (operator.layout(), operator.activity.grid());
    let plane = u.len() / 2;
    // Inside the membrane the stress β cof f has no forces.
    let of_sides = grid.boundary().map(|_| cofactor_stress(operator.material));
    let mut sums = Vec::new();
    let mut gradients = [[[0.0; 2]; 2]; N];
    let mut of_laminate = None;
    let mut current = None;
    unknowns.for_each_entry::<N>(poses, |([column, row], c, node), entries| {
        let mut entries = entries.peekable();
        if entries.peek().is_none() {
            return;
        }
        if current.replace([column, row]) != Some([column, row]) {
            let nodes = grid.nodes_of::<N>([column, row]);
            gradients = grid.gradients::<E, N>([column, row], &[0, 1].map(|c| nodes.map(|at| u[at + c * plane])));
            let laminate = operator
                .activity
                .covered()
                .and_then(|covered| covered.laminate([column, row]));
            of_laminate = laminate.map(|laminate| {
                gradients.map(|gradient| laminate.excess_moduli(operator.material, gradient).unwrap_or_default())
            });
        }
        let mut unit = [[0.0; N]; 2];
        unit[c][node] = 1.0;
        let changes = grid.changes::<E, N>([column, row], &unit);
        let stresses = std::array::from_fn(|q| {
            let active = operator.activity.at_point(row, q, N)[column];
            let linear = operator.material.tangent(gradients[q], active, changes[q]);
            let linear = match of_sides {
                Some(factor) => add_scaled(linear, factor, cofactor(changes[q])),
                None => linear,
            };
            let of_material = match &of_laminate {
                Some(moduli) => add_scaled(linear, 1.0, excess_tangent(&moduli[q], changes[q])),
                None => linear,
            };
            let Some(memory) = operator.activity.memory() else {
                return of_material;
            };
            let numbers: &[f64] = memory.view();
            let numbers = std::array::from_fn(|at| numbers[memory::line(layout, N, row, q, at) + column]);
            add_scaled(of_material, 1.0, memory::tangent(numbers, gradients[q], changes[q]))
        });
        let forces = grid.forces::<E, N>([column, row], stresses);
        sums.extend(entries.map(|entry| entry.weight * forces[entry.force / N][entry.force % N]));
    });
    sums
}

/// Returns the entries of the consistent mass in the order of [`Unknowns::for_each_entry`].
fn assemble_mass<E: Element<N>, const N: usize>(unknowns: &Unknowns, grid: &Grid, poses: &[Pose]) -> Vec<f64> {
    let mut sums = Vec::new();
    let mut masses = (1.0, [[0.0; N]; N]);
    let mut current = None;
    unknowns.for_each_entry::<N>(poses, |(element, c, node), entries| {
        if current.replace(element) != Some(element) {
            masses = grid.mass_of::<E, N>(element);
        }
        sums.extend(entries.map(|entry| match entry.force / N == c {
            true => entry.weight * masses.0 * masses.1[node][entry.force % N],
            false => 0.0,
        }));
    });
    sums
}
