//! The inverse Laplacian of a rectangle by fast diagonalisation.
//!
//! On a tensor-product mesh the Laplacian is K⊗M + M⊗K with the one-dimensional stiffness K and mass M. With Q the
//! generalised eigenvectors, KQ = MQΛ and QᵀMQ = I, a transform by Q along x gives one banded system K + λM along y for
//! each mode (Lynch, Rice and Thomas, Numer. Math. 6 (1964) 185; Buzbee, Golub and Nielson, SIAM J. Numer. Anal. 7
//! (1970) 627). Side lengths are those of [`Grid`]: on the membrane the operator is λ₁²∂xx + λ₂²∂yy. Modes are even or
//! odd about the middle of the membrane, which halves the cost of transforms. At a prestretch of 3 the tangent differs
//! from the Laplacian by a quarter at most, so conjugate gradients need the same few iterations on every mesh. Single
//! precision is enough for a preconditioner.

use std::collections::BTreeMap;
use std::ops::Range;

use deaflow_linalg::Mat;
use pulp::{Simd, WithSimd};

use crate::registers::dispatch_widest;

use super::element::Line;
use super::error::SetupError;
use super::gemm::{Layout, Product};
use super::grid::Grid;
use super::krylov::{add_scaled, dot};
use super::lanes::{Value, WIDEST, Wide};
use super::layout::NodeLayout;
use super::modes::{half_modes, line_matrices};
use deaflow_field::Order;

/// The inverse Laplacian of the full rectangle, with zero values on its edge.
pub(super) struct Rectangle {
    layout: NodeLayout,
    /// Half the interior nodes of a row, including a middle node; also the number of even modes.
    half: usize,
    /// `half` with padding.
    width: usize,
    /// Transforms from folded rows to modes, even then odd: `[position][mode]`.
    forward: [Vec<f32>; 2],
    /// Transforms from modes to folded rows: `[mode][position]`.
    backward: [Vec<f32>; 2],
    columns: Columns,
}

/// Some nodes of a rectangle: their rows, and the modes along x at their columns.
pub(super) struct ModalNodes {
    rows: Vec<usize>,
    /// `[node][mode]`.
    modes: Vec<f32>,
}

impl ModalNodes {
    fn modes_of(&self, node: usize, width: usize) -> &[f32] {
        &self.modes[node * width..][..width]
    }
}

/// Vectors for [`Rectangle::solve`].
pub(super) struct RectangleScratch {
    folded: Vec<f32>,
    modes: Vec<f32>,
}

impl Rectangle {
    pub(super) fn new(grid: &Grid, mass_factor: f64) -> Result<Self, SetupError> {
        let layout = grid.layout();
        let [(stiffness, mass), columns] = [0, 1].map(|axis| {
            let size = |at: usize| grid.sides([at; 2])[axis];
            match grid.order() {
                Order::Bilinear => line_matrices(grid.elements()[axis], &Line::LINEAR, size),
                Order::Biquadratic => line_matrices(grid.elements()[axis], &Line::QUADRATIC, size),
            }
        });
        let half = (layout.nodes()[0] - 1) / 2;
        let width = half.max(1).next_multiple_of(WIDEST);
        let [even, odd] = [false, true].map(|odd| half_modes(&stiffness, &mass, odd));
        let modes = [
            even.ok_or(SetupError::Eigenvectors)?,
            odd.ok_or(SetupError::Eigenvectors)?,
        ];
        let mut values = vec![1.0; 2 * width];
        for (parity, (_, eigenvalues)) in modes.iter().enumerate() {
            let of_modes = values[parity * width..].iter_mut().zip(eigenvalues);
            of_modes.for_each(|(value, eigenvalue)| *value = eigenvalue + mass_factor);
        }
        let order = folded_order(layout);
        let middle = layout.nodes()[0] / 2 - 1;
        let table = |entry: &dyn Fn(usize, usize) -> f64| -> Vec<f32> {
            (0..half * width)
                .map(|at| entry(at / width, at % width) as f32)
                .collect()
        };
        let entry = |parity: usize, position: usize, mode: usize| {
            let (vectors, _): &(Mat<f64>, Vec<f64>) = &modes[parity];
            let node = order[position];
            if node < vectors.nrows() && mode < vectors.ncols() {
                vectors[(node, mode)]
            } else {
                0.0
            }
        };
        // Folding counts a node in the middle twice.
        let is_shared = layout.nodes()[0] % 2 == 1;
        let share = |position: usize| {
            if is_shared && order[position] == middle {
                0.5
            } else {
                1.0
            }
        };
        Ok(Self {
            layout,
            half,
            width,
            forward: [0, 1].map(|parity| table(&|position, mode| share(position) * entry(parity, position, mode))),
            backward: [0, 1].map(|parity| {
                table(&|mode, position| {
                    if position < half {
                        entry(parity, position, mode)
                    } else {
                        0.0
                    }
                })
            }),
            columns: Columns::new(layout, &columns, &values),
        })
    }

    /// Returns the nodes at these indices of a vector, of the first component.
    pub(super) fn nodes(&self, indices: &[usize]) -> ModalNodes {
        let (degree, part, stride) = (self.layout.degree(), self.layout.part(), self.layout.stride());
        let order = folded_order(self.layout);
        let node = |index: &usize| {
            let (row, within) = (index / stride, index % stride);
            (row, self.modes_at(within % part * degree + within / part, &order))
        };
        let (rows, modes): (Vec<usize>, Vec<Vec<f32>>) = indices.iter().map(node).unzip();
        ModalNodes {
            rows,
            modes: modes.concat(),
        }
    }

    /// Returns the modes at a column of nodes, even then odd; `order` is the [`folded_order`].
    fn modes_at(&self, column: usize, order: &[usize]) -> Vec<f32> {
        let last = self.layout.nodes()[0] - 1;
        let (node, sign) = if 2 * column <= last {
            (column - 1, 1.0)
        } else {
            (last - column - 1, -1.0)
        };
        let position = order.iter().position(|at| *at == node);
        let position = position.expect("the node is not on the frame");
        let mut modes = vec![0.0; 2 * self.width];
        for mode in 0..self.half {
            modes[mode] = self.backward[0][mode * self.width + position];
            modes[self.width + mode] = sign * self.backward[1][mode * self.width + position];
        }
        modes
    }

    /// Returns the inverse between some nodes: sums over the modes along x of solutions along y for a load on each row.
    pub(super) fn between(&self, nodes: &ModalNodes) -> Mat<f64> {
        let width = 2 * self.width;
        let mut by_row: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (at, row) in nodes.rows.iter().enumerate() {
            by_row.entry(*row).or_default().push(at);
        }
        let mut plane = vec![0.0_f32; self.layout.nodes()[1] * width];
        let mut weighted = vec![0.0_f32; width];
        let mut matrix = Mat::zeros(nodes.rows.len(), nodes.rows.len());
        for (&row, loaded) in &by_row {
            plane.fill(0.0);
            plane[row * width..][..width].fill(1.0);
            self.solve_columns(&mut plane);
            for &from in loaded {
                for (&other, there) in &by_row {
                    let pairs = nodes.modes_of(from, width).iter().zip(&plane[other * width..]);
                    weighted
                        .iter_mut()
                        .zip(pairs)
                        .for_each(|(weighted, (mode, g))| *weighted = mode * g);
                    for &to in there {
                        matrix[(to, from)] = dot(&weighted, nodes.modes_of(to, width));
                    }
                }
            }
        }
        matrix
    }

    /// Returns the vectors for a solve.
    pub(super) fn scratch(&self) -> RectangleScratch {
        let len = 2 * self.layout.nodes()[1] * 2 * self.width;
        RectangleScratch {
            folded: vec![0.0; len],
            modes: vec![0.0; len],
        }
    }

    /// Writes the solution for `r`, zero on the edge, into the interior of `z`.
    pub(super) fn solve(&self, r: &[f32], z: &mut [f32], scratch: &mut RectangleScratch) {
        self.solve_with(r, z, scratch, |_, _| {});
    }

    /// Solves with forces on some nodes that depend on the solution without them: `correct` replaces the values of both
    /// components on the nodes by the forces.
    ///
    /// The solution without them is evaluated from its modes, so it needs no further transforms.
    pub(super) fn solve_corrected(
        &self,
        r: &[f32],
        nodes: &ModalNodes,
        z: &mut [f32],
        (scratch, values): (&mut RectangleScratch, &mut [Vec<f32>; 2]),
        correct: impl FnOnce(&mut [Vec<f32>; 2]),
    ) {
        let (width, plane) = (2 * self.width, self.layout.nodes()[1] * 2 * self.width);
        self.solve_with(r, z, scratch, |forces, modes| {
            modes.copy_from_slice(forces);
            self.solve_columns(modes);
            for (values, modes) in values.iter_mut().zip(modes.chunks_exact(plane)) {
                for (at, (value, row)) in values.iter_mut().zip(&nodes.rows).enumerate() {
                    *value = dot(&modes[row * width..][..width], nodes.modes_of(at, width)) as f32;
                }
            }
            correct(values);
            for (values, forces) in values.iter().zip(forces.chunks_exact_mut(plane)) {
                for (at, (value, row)) in values.iter().zip(&nodes.rows).enumerate() {
                    add_scaled(&mut forces[row * width..][..width], *value, nodes.modes_of(at, width));
                }
            }
        });
    }

    /// Solves with a change of the modes of the right-hand side.
    fn solve_with(
        &self,
        r: &[f32],
        z: &mut [f32],
        scratch: &mut RectangleScratch,
        change: impl FnOnce(&mut [f32], &mut [f32]),
    ) {
        let RectangleScratch { folded, modes } = scratch;
        self.fold(r, folded);
        self.transform(&self.forward, folded, modes);
        change(modes, folded);
        self.solve_columns(modes);
        self.transform(&self.backward, modes, folded);
        self.unfold(folded, z);
    }

    /// Solves along y for all modes of each component, in place.
    fn solve_columns(&self, modes: &mut [f32]) {
        dispatch_widest(ColumnSolve {
            columns: &self.columns,
            modes,
        });
    }

    fn transform(&self, tables: &[Vec<f32>; 2], source: &[f32], target: &mut [f32]) {
        for (parity, table) in tables.iter().enumerate() {
            let layout = Layout {
                offset: parity * self.width,
                stride: 2 * self.width,
            };
            let product = Product {
                left: source,
                left_layout: layout,
                right: table,
                width: self.width,
                inner: self.half,
                rows: 2 * self.layout.nodes()[1],
                target,
                target_layout: layout,
            };
            product.run();
        }
    }

    /// Writes sums and differences of the two halves of each row.
    fn fold(&self, r: &[f32], folded: &mut [f32]) {
        let part = self.layout.part();
        dispatch_widest(
            #[inline(always)]
            || {
                let rows = r.chunks_exact(self.layout.stride());
                for (row, target) in rows.zip(folded.chunks_exact_mut(2 * self.width)) {
                    let (even, odd) = target.split_at_mut(self.width);
                    let mut start = 0;
                    for (inner, nodes) in row.chunks_exact(part).enumerate() {
                        let [left, right] = halves(self.layout, inner);
                        let span = start..start + left.len();
                        start = span.end;
                        let (left, right) = (&nodes[left], &nodes[right]);
                        let targets = even[span.clone()].iter_mut().zip(&mut odd[span]);
                        for ((even, odd), (a, b)) in targets.zip(left.iter().zip(right.iter().rev())) {
                            *even = a + b;
                            *odd = a - b;
                        }
                    }
                }
            },
        );
    }

    /// Writes rows from the sums and differences of their halves.
    fn unfold(&self, folded: &[f32], z: &mut [f32]) {
        let part = self.layout.part();
        let [_, nodes] = self.layout.nodes();
        dispatch_widest(
            #[inline(always)]
            || {
                let rows = z
                    .chunks_exact_mut(self.layout.stride())
                    .zip(folded.chunks_exact(2 * self.width));
                for (at, (row, source)) in rows.enumerate() {
                    if at % nodes == 0 || at % nodes == nodes - 1 {
                        continue;
                    }
                    let (even, odd) = source.split_at(self.width);
                    let mut start = 0;
                    for (inner, line) in row.chunks_exact_mut(part).enumerate() {
                        let [left, right] = halves(self.layout, inner);
                        let span = start..start + left.len();
                        start = span.end;
                        let (even, odd) = (&even[span.clone()], &odd[span]);
                        line[left]
                            .iter_mut()
                            .zip(even.iter().zip(odd))
                            .for_each(|(z, (e, o))| *z = e + o);
                        line[right]
                            .iter_mut()
                            .rev()
                            .zip(even.iter().zip(odd))
                            .for_each(|(z, (e, o))| *z = e - o);
                    }
                }
            },
        );
    }
}

/// Returns the interior nodes of a part of a row in the left half, and their mirror images in the right one. A node in
/// the middle is the last of the left half and its own image.
#[inline(always)]
fn halves(layout: NodeLayout, inner: usize) -> [Range<usize>; 2] {
    let elements = layout.columns();
    let (first, count) = match inner {
        0 => (1, elements / 2),
        _ => (0, elements.div_ceil(2)),
    };
    [first..first + count, elements - count..elements]
}

/// Returns the index of the interior node for each position of a folded row.
fn folded_order(layout: NodeLayout) -> Vec<usize> {
    let degree = layout.degree();
    let parts = (0..degree).flat_map(|inner| {
        let [left, _] = halves(layout, inner);
        left.map(move |at| at * degree + inner - 1)
    });
    parts.collect()
}

/// LDLᵀ of K + λM along y for each mode, `[row][mode]`.
struct Columns {
    nodes: usize,
    width: usize,
    /// 1/D.
    inverse: Vec<f32>,
    /// L below the diagonal, one array per distance from it.
    lower: Vec<Vec<f32>>,
}

impl Columns {
    fn new(layout: NodeLayout, (stiffness, mass): &(Mat<f64>, Mat<f64>), values: &[f64]) -> Self {
        let ([_, nodes], width, band) = (layout.nodes(), values.len(), layout.degree());
        let mut inverse = vec![0.0; nodes * width];
        let mut lower = vec![vec![0.0; nodes * width]; band];
        for (mode, value) in values.iter().enumerate() {
            let entry = |i: usize, k: usize| stiffness[(i, k)] + value * mass[(i, k)];
            let (pivots, factors) = banded_factors(nodes - 2, band, &entry);
            for (i, pivot) in pivots.iter().enumerate() {
                inverse[(i + 1) * width + mode] = (1.0 / pivot) as f32;
                for (distance, factor) in factors[i].iter().enumerate() {
                    lower[distance][(i + 1) * width + mode] = *factor as f32;
                }
            }
        }
        Self {
            nodes,
            width,
            inverse,
            lower,
        }
    }
}

/// Returns D and the rows of L, `[row][distance − 1]`, of a symmetric banded matrix.
fn banded_factors(n: usize, band: usize, entry: &dyn Fn(usize, usize) -> f64) -> (Vec<f64>, Vec<Vec<f64>>) {
    let (mut pivots, mut rows) = (vec![0.0; n], vec![vec![0.0; band]; n]);
    for i in 0..n {
        for distance in (1..=band.min(i)).rev() {
            let k = i - distance;
            let known = (1..=band - distance).filter(|d| *d <= k);
            let sum: f64 = known
                .map(|d| rows[i][distance + d - 1] * pivots[k - d] * rows[k][d - 1])
                .sum();
            rows[i][distance - 1] = (entry(i, k) - sum) / pivots[k];
        }
        let sum: f64 = (1..=band.min(i)).map(|d| rows[i][d - 1].powi(2) * pivots[i - d]).sum();
        pivots[i] = entry(i, i) - sum;
    }
    (pivots, rows)
}

/// Solves along y for all modes of each component, in place.
struct ColumnSolve<'a> {
    columns: &'a Columns,
    modes: &'a mut [f32],
}

impl WithSimd for ColumnSolve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Columns {
            nodes,
            width,
            inverse,
            lower,
        } = self.columns;
        for plane in self.modes.chunks_exact_mut(nodes * width) {
            for row in 1..nodes - 1 {
                let (before, rest) = plane.split_at_mut(row * width);
                for (distance, lower) in lower.iter().enumerate().take(row) {
                    let source = &before[(row - distance - 1) * width..][..*width];
                    subtract_product::<S>(simd, &mut rest[..*width], &lower[row * width..], source);
                }
            }
            for row in (1..nodes - 1).rev() {
                let (before, after) = plane.split_at_mut((row + 1) * width);
                let target = &mut before[row * width..];
                scale::<S>(simd, target, &inverse[row * width..]);
                for (distance, lower) in lower.iter().enumerate().take(nodes - 1 - row) {
                    let factors = &lower[(row + distance + 1) * width..];
                    subtract_product::<S>(simd, target, factors, &after[distance * width..][..*width]);
                }
            }
        }
    }
}

/// target ← target − factors · source.
#[inline(always)]
fn subtract_product<S: Simd>(simd: S, target: &mut [f32], factors: &[f32], source: &[f32]) {
    for at in (0..target.len()).step_by(S::F32_LANES) {
        let factor: Wide<S, f32> = Wide::load(simd, &factors[at..]);
        let sum = (-factor).madd(Wide::load(simd, &source[at..]), Wide::load(simd, &target[at..]));
        sum.store(&mut target[at..]);
    }
}

/// target ← factors · target.
#[inline(always)]
fn scale<S: Simd>(simd: S, target: &mut [f32], factors: &[f32]) {
    for at in (0..target.len()).step_by(S::F32_LANES) {
        let factor: Wide<S, f32> = Wide::load(simd, &factors[at..]);
        (factor * Wide::load(simd, &target[at..])).store(&mut target[at..]);
    }
}
