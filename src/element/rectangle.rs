//! The inverse Laplacian of a rectangle by fast diagonalisation.
//!
//! On a tensor-product mesh the Laplacian is K⊗M + M⊗K with the one-dimensional stiffness K and mass M. With Q the
//! generalised eigenvectors, KQ = MQΛ and QᵀMQ = I, a transform by Q along x gives one banded system K + λM along y for
//! each mode (Lynch, Rice and Thomas, Numer. Math. 6 (1964) 185; Buzbee, Golub and Nielson, SIAM J. Numer. Anal. 7
//! (1970) 627). Side lengths are those of [`Grid`]: on the membrane the operator is λ₁²∂xx + λ₂²∂yy. On a rectangle
//! that is much longer along x the transforms are along y, and the systems along x. At a prestretch of 3 the tangent
//! differs from the Laplacian by a quarter at most, so conjugate gradients need the same few iterations on every mesh.
//! Single precision is enough for a preconditioner.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::ops::Range;

use deaflow_linalg::Mat;

use super::cell_transform::CellTransform;
use super::columns::{BLOCK, Columns};
use super::element::Line;
use super::error::SetupError;
use super::grid::Grid;
use super::krylov::{add_scaled, dot};
use super::layout::NodeLayout;
use super::line_transform::LineTransform;
use super::modes::matrices_at;
use super::side_transform::SideTransform;
use deaflow_field::Order;

/// Ratio of columns to rows of nodes above which transforms are along y. They cost as much as the product of the number
/// of nodes and that of nodes along their direction.
const LONG: usize = 3;

/// The same ratio where sides are not held, in halves: transforms then cost more.
const LONG_IN_HALVES: usize = 3;

/// Number of cells along the transforms above which they make use of the period of the cells.
const MANY_CELLS: usize = 100;

/// Returns whether rows of many cells are transformed on a raster with these columns and rows, or columns and rows may
/// be exchanged. Results then differ in their last digits from those of earlier versions.
pub fn is_large_or_long([columns, rows]: [usize; 2]) -> bool {
    columns.max(rows) > MANY_CELLS || columns > LONG * rows
}

/// Transforms between the nodes of rows and their modes, with QᵀMQ = I.
pub(super) trait Transform: Send + Sync {
    /// Returns the length of a row of modes with padding, a multiple of [`BLOCK`].
    fn width(&self) -> usize;

    /// Returns the eigenvalue of each mode, `None` in the padding.
    fn values(&self) -> Vec<Option<f64>>;

    /// Returns the modes at a column of nodes that is not the first or last.
    fn modes_at(&self, column: usize) -> Vec<f32>;

    /// Writes the modes of all rows of nodes, which are zero at their ends. `spare` is as long as `modes`.
    fn forward(&self, nodes: &[f32], spare: &mut [f32], modes: &mut [f32]);

    /// Writes the nodes of all rows of modes except the first and last, without their ends. Changes the modes.
    fn backward(&self, modes: &mut [f32], spare: &mut [f32], nodes: &mut [f32]);
}

/// The inverse Laplacian of the full rectangle, with zero values where its sides are held.
pub(super) struct Rectangle {
    /// Layout of the vectors.
    given: NodeLayout,
    /// Layout with transforms along rows: that of the vectors, or with columns and rows exchanged.
    layout: NodeLayout,
    /// One for both components of vectors, or one for each if sides hold different ones.
    components: Vec<Component>,
}

/// The inverse for a component of vectors, or for both.
struct Component {
    transform: Box<dyn Transform>,
    columns: Columns,
}

/// Some nodes of a rectangle: their rows, and the modes along x at their columns.
pub(super) struct ModalNodes {
    rows: Vec<usize>,
    /// For each component of a rectangle, `[node][mode]`; zero at nodes that do not move.
    modes: Vec<Vec<f32>>,
}

impl ModalNodes {
    fn modes_of(&self, component: usize, node: usize, width: usize) -> &[f32] {
        &self.modes[component][node * width..][..width]
    }
}

/// Vectors for [`Rectangle::solve`].
pub(super) struct RectangleScratch {
    /// A vector with columns and rows exchanged; empty if they are not.
    exchanged: Vec<f32>,
    folded: Vec<f32>,
    modes: Vec<f32>,
}

/// Returns stiffness and mass of the elements along an axis of a grid at these nodes.
pub(super) fn matrices_along(grid: &Grid, axis: usize, free: Range<usize>) -> (Mat<f64>, Mat<f64>) {
    matrices_of(grid.order(), free, grid.elements()[axis], |at| {
        grid.sides([at; 2])[axis]
    })
}

/// Returns stiffness and mass of a line of elements of some sizes at these nodes.
pub(super) fn matrices_of(
    order: Order,
    free: Range<usize>,
    elements: usize,
    size: impl Fn(usize) -> f64,
) -> (Mat<f64>, Mat<f64>) {
    match order {
        Order::Bilinear => matrices_at(free, elements, &Line::LINEAR, size),
        Order::Biquadratic => matrices_at(free, elements, &Line::QUADRATIC, size),
    }
}

/// Returns the layout of the vectors of a grid, that with transforms along rows, and its axes in the grid: exchanged if
/// there are more than this many half columns of nodes for each row. Mapped elements are no part of vectors.
fn layouts(grid: &Grid, long_in_halves: usize) -> (NodeLayout, NodeLayout, [usize; 2]) {
    let (elements, free) = (grid.elements(), grid.layout().free_sides());
    let layout = |elements, free| NodeLayout::new(elements, grid.order()).with_free_sides(free);
    let given = layout(elements, free);
    let [columns, rows] = given.nodes();
    match 2 * columns > long_in_halves * rows {
        true => (given, layout([elements[1], elements[0]], free.exchanged()), [1, 0]),
        false => (given, given, [0, 1]),
    }
}

/// Adds a mass to the eigenvalues of modes; those of the padding become 1.
fn values_with(transform: &dyn Transform, mass: f64) -> Vec<f64> {
    let values = transform.values().into_iter();
    values.map(|value| value.map_or(1.0, |value| value + mass)).collect()
}

/// The mass that is added where no side holds a component, in units of the smallest eigenvalue that is not zero: the
/// component can then move as a whole, which only bodies, bars and frames resist.
const FLOATING_MASS: f64 = 0.1;

impl Rectangle {
    pub(super) fn new(grid: &Grid, mass_factor: f64) -> Result<Self, SetupError> {
        if !grid.layout().free_sides().is_empty() {
            return Self::with_free_sides(grid, mass_factor);
        }
        let (given, layout, axes) = layouts(grid, 2 * LONG);
        let interior = |axis: usize| 1..given.nodes()[axis] - 1;
        let [(stiffness, mass), columns] = axes.map(|axis| matrices_along(grid, axis, interior(axis)));
        let [cells, _] = axes.map(|axis| grid.raster().sides()[axis]);
        let transform: Box<dyn Transform> = match cells > MANY_CELLS {
            true => Box::new(CellTransform::new(layout, cells, &stiffness, &mass)?),
            false => Box::new(LineTransform::new(layout, &stiffness, &mass)?),
        };
        let values = values_with(&*transform, mass_factor);
        let columns = Columns::new(layout, interior(axes[1]), &columns, &values);
        Ok(Self {
            given,
            layout,
            components: vec![Component { transform, columns }],
        })
    }

    fn with_free_sides(grid: &Grid, mass_factor: f64) -> Result<Self, SetupError> {
        let (given, layout, axes) = layouts(grid, LONG_IN_HALVES);
        let (nodes, free) = (layout.nodes(), layout.free_sides());
        let ranges = |c: usize| [0, 1].map(|axis| free.range(axis, c, nodes[axis]));
        let component = |[along, across]: [Range<usize>; 2]| {
            let is_floating = along.len() == nodes[0] && across.len() == nodes[1];
            let lowest = |axis: usize| {
                let length: f64 = (0..grid.elements()[axis]).map(|at| grid.sides([at; 2])[axis]).sum();
                (PI / length).powi(2)
            };
            let mass = match is_floating && mass_factor == 0.0 {
                true => FLOATING_MASS * f64::min(lowest(0), lowest(1)),
                false => mass_factor,
            };
            let transform = SideTransform::new(layout, along.clone(), &matrices_along(grid, axes[0], along))?;
            let values = values_with(&transform, mass);
            Ok(Component {
                columns: Columns::new(layout, across.clone(), &matrices_along(grid, axes[1], across), &values),
                transform: Box::new(transform),
            })
        };
        let own = if ranges(0) == ranges(1) { 1 } else { 2 };
        Ok(Self {
            given,
            layout,
            components: (0..own).map(|c| component(ranges(c))).collect::<Result<_, _>>()?,
        })
    }

    /// Returns how many components of vectors have an inverse of their own.
    pub(super) fn components(&self) -> usize {
        self.components.len()
    }

    /// Returns the length of rows of modes for each component of vectors.
    fn widths(&self) -> [usize; 2] {
        [0, 1].map(|c| self.components[c % self.components.len()].transform.width())
    }

    /// Splits vectors, and modes, into the parts that each component transforms.
    fn parts(&self) -> Vec<(&Component, Range<usize>, Range<usize>)> {
        let (rows, stride) = (self.layout.nodes()[1], self.layout.stride());
        let [first, second] = self.widths();
        match &self.components[..] {
            [both] => vec![(both, 0..2 * rows * stride, 0..2 * rows * first)],
            own => {
                let nodes = [0..rows * stride, rows * stride..2 * rows * stride];
                let modes = [0..rows * first, rows * first..rows * (first + second)];
                own.iter()
                    .zip(nodes.into_iter().zip(modes))
                    .map(|(own, (nodes, modes))| (own, nodes, modes))
                    .collect()
            }
        }
    }

    /// Returns the column and row of the node at an index of a vector, of the first component, with transforms along
    /// rows.
    pub(super) fn place(&self, index: usize) -> [usize; 2] {
        let (degree, part, stride) = (self.given.degree(), self.given.part(), self.given.stride());
        let (row, within) = (index / stride, index % stride);
        let column = within % part * degree + within / part;
        if self.is_exchanged() {
            [row, column]
        } else {
            [column, row]
        }
    }

    /// Returns the nodes at these indices of a vector, of the first component.
    pub(super) fn nodes(&self, indices: &[usize]) -> ModalNodes {
        let places: Vec<[usize; 2]> = indices.iter().map(|index| self.place(*index)).collect();
        let free = self.layout.free_sides();
        let modes = self.components.iter().enumerate().map(|(c, component)| {
            let moves = |[column, row]: [usize; 2]| {
                let nodes = self.layout.nodes();
                free.range(0, c, nodes[0]).contains(&column) && free.range(1, c, nodes[1]).contains(&row)
            };
            let at = |place: &[usize; 2]| match moves(*place) {
                true => component.transform.modes_at(place[0]),
                false => vec![0.0; component.transform.width()],
            };
            places.iter().flat_map(at).collect()
        });
        ModalNodes {
            modes: modes.collect(),
            rows: places.iter().map(|[_, row]| *row).collect(),
        }
    }

    /// Returns the inverse for a component between some nodes: sums over the modes along x of solutions along y for a
    /// load on each row.
    pub(super) fn between(&self, component: usize, nodes: &ModalNodes) -> Mat<f64> {
        let Component { transform, columns } = &self.components[component];
        let width = transform.width();
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
            columns.solve(&mut plane);
            for &from in loaded {
                for (&other, there) in &by_row {
                    let pairs = nodes
                        .modes_of(component, from, width)
                        .iter()
                        .zip(&plane[other * width..]);
                    weighted
                        .iter_mut()
                        .zip(pairs)
                        .for_each(|(weighted, (mode, g))| *weighted = mode * g);
                    for &to in there {
                        matrix[(to, from)] = dot(&weighted, nodes.modes_of(component, to, width));
                    }
                }
            }
        }
        matrix
    }

    /// Returns sums of the inverse for a component over the nodes of clusters: `of` is the cluster of each node. Modes
    /// along x are left out at distances along y over which their response to a load has decayed to rounding.
    pub(super) fn between_clusters(
        &self,
        component: usize,
        nodes: &ModalNodes,
        of: &[usize],
        count: usize,
    ) -> Mat<f64> {
        let Component { transform, columns } = &self.components[component];
        let width = transform.width();
        // The modes of the nodes of a cluster on one row, added up.
        let mut by_row: BTreeMap<usize, BTreeMap<usize, Vec<f32>>> = BTreeMap::new();
        for (at, (row, cluster)) in nodes.rows.iter().zip(of).enumerate() {
            let sum = by_row.entry(*row).or_default().entry(*cluster);
            let sum = sum.or_insert_with(|| vec![0.0; width]);
            add_scaled(sum, 1.0, nodes.modes_of(component, at, width));
        }
        let mut plane = vec![0.0_f32; self.layout.nodes()[1] * width];
        let mut weighted = vec![0.0_f32; width];
        let mut matrix = Mat::zeros(count, count);
        for (&row, loaded) in &by_row {
            let ends = columns.respond(row, &mut plane);
            for (&other, there) in by_row.range(row..) {
                let kept = joined(ends.iter().map(|end| *end > other));
                if kept.is_empty() {
                    break;
                }
                for (&from, modes) in loaded {
                    for kept in &kept {
                        let pairs = modes[kept.clone()].iter().zip(&plane[other * width..][kept.clone()]);
                        let weighted = weighted[kept.clone()].iter_mut().zip(pairs);
                        weighted.for_each(|(weighted, (mode, g))| *weighted = mode * g);
                    }
                    for (&to, modes) in there {
                        let parts = kept
                            .iter()
                            .map(|kept| dot(&weighted[kept.clone()], &modes[kept.clone()]));
                        let value: f64 = parts.sum();
                        matrix[(to, from)] += value;
                        if other > row {
                            matrix[(from, to)] += value;
                        }
                    }
                }
            }
        }
        matrix
    }

    /// Returns the vectors for a solve.
    pub(super) fn scratch(&self) -> RectangleScratch {
        let len = self.layout.nodes()[1] * self.widths().iter().sum::<usize>();
        let exchanged = if self.is_exchanged() {
            self.layout.vector_len()
        } else {
            0
        };
        RectangleScratch {
            exchanged: vec![0.0; exchanged],
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
        let (widths, rows) = (self.widths(), self.layout.nodes()[1]);
        let plane = |c: usize| match c {
            0 => 0..rows * widths[0],
            _ => rows * widths[0]..rows * (widths[0] + widths[1]),
        };
        let own = |c: usize| c % self.components.len();
        self.solve_with(r, z, scratch, |forces, modes| {
            modes.copy_from_slice(forces);
            for (component, _, part) in self.parts() {
                component.columns.solve(&mut modes[part]);
            }
            for (c, values) in values.iter_mut().enumerate() {
                let (modes, width) = (&modes[plane(c)], widths[c]);
                for (at, (value, row)) in values.iter_mut().zip(&nodes.rows).enumerate() {
                    *value = dot(&modes[row * width..][..width], nodes.modes_of(own(c), at, width)) as f32;
                }
            }
            correct(values);
            for (c, values) in values.iter().enumerate() {
                let (forces, width) = (&mut forces[plane(c)], widths[c]);
                for (at, (value, row)) in values.iter().zip(&nodes.rows).enumerate() {
                    add_scaled(
                        &mut forces[row * width..][..width],
                        *value,
                        nodes.modes_of(own(c), at, width),
                    );
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
        let RectangleScratch {
            exchanged,
            folded,
            modes,
        } = scratch;
        let is_exchanged = self.is_exchanged();
        if is_exchanged {
            exchange([self.given, self.layout], r, exchanged);
        }
        for (component, nodes, part) in self.parts() {
            let source = if is_exchanged { &exchanged[nodes] } else { &r[nodes] };
            component
                .transform
                .forward(source, &mut folded[part.clone()], &mut modes[part]);
        }
        change(modes, folded);
        for (component, nodes, part) in self.parts() {
            component.columns.solve(&mut modes[part.clone()]);
            let target = if is_exchanged {
                &mut exchanged[nodes]
            } else {
                &mut z[nodes]
            };
            component
                .transform
                .backward(&mut modes[part.clone()], &mut folded[part], target);
        }
        if is_exchanged {
            exchange([self.layout, self.given], exchanged, z);
        }
    }

    /// Returns whether columns and rows are exchanged before a solve.
    fn is_exchanged(&self) -> bool {
        self.layout != self.given
    }
}

/// Returns the modes of the blocks that are kept, neighbours in one range.
fn joined(kept: impl Iterator<Item = bool>) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for (at, _) in kept.enumerate().filter(|(_, kept)| *kept) {
        let block = BLOCK * at..BLOCK * (at + 1);
        match ranges.last_mut() {
            Some(last) if last.end == block.start => last.end = block.end,
            _ => ranges.push(block),
        }
    }
    ranges
}

/// Copies a vector to one with columns and rows exchanged; without its edge if all sides are held.
fn exchange([from, to]: [NodeLayout; 2], source: &[f32], target: &mut [f32]) {
    let (degree, [columns, rows]) = (from.degree(), from.nodes());
    let edge = usize::from(from.free_sides().is_empty());
    for (c, row) in (0..2).flat_map(|c| (edge..rows - edge).map(move |row| (c, row))) {
        let (first, step) = (to.index(c, row, 0), to.stride());
        for inner in 0..degree {
            let start = from.index_in(c, 0, inner, row);
            let nodes = (inner..columns).step_by(degree).zip(&source[start..]);
            let inside = nodes.filter(|(column, _)| (edge..columns - edge).contains(column));
            inside.for_each(|(column, value)| target[first + column * step] = *value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modes::line_matrices;
    use crate::sheet::Sheet;
    use deaflow_field::Mesh;
    use deaflow_pattern::{Membrane, Raster};

    fn sheet(cells: [usize; 2], size_mm: [f64; 2]) -> Sheet {
        Sheet {
            membrane: Membrane {
                raster: Raster::new(cells[0], cells[1]).unwrap(),
                size_mm,
            },
            ..Sheet::paper()
        }
    }

    /// Checks QᵀMQ = I, QᵀKQ = Λ, and that the transforms are the products with Qᵀ and Q.
    fn check(transform: &dyn Transform, layout: NodeLayout, stiffness: &Mat<f64>, mass: &Mat<f64>, context: &str) {
        let ([columns, rows], width) = (layout.nodes(), transform.width());
        let modes: Vec<Vec<f32>> = (1..columns - 1).map(|column| transform.modes_at(column)).collect();
        let values = transform.values();
        let known: Vec<usize> = (0..width).filter(|mode| values[*mode].is_some()).collect();
        assert_eq!((values.len(), known.len()), (width, columns - 2), "{context}");
        let largest = values
            .iter()
            .flatten()
            .fold(0.0, |largest: f64, value| largest.max(*value));
        for &mode in &known {
            let of = |node: usize, mode: usize| f64::from(modes[node][mode]);
            let image = |matrix: &Mat<f64>| -> Vec<f64> {
                let row = |i: usize| (0..columns - 2).map(|k| matrix[(i, k)] * of(k, mode)).sum();
                (0..columns - 2).map(row).collect()
            };
            let (stiff, heavy) = (image(stiffness), image(mass));
            for &other in &known {
                let product = |image: &[f64]| -> f64 { (0..columns - 2).map(|i| of(i, other) * image[i]).sum() };
                let is_same = if mode == other { 1.0 } else { 0.0 };
                assert!((product(&heavy) - is_same).abs() < 1e-5, "{context}: {mode} {other}");
                let value = values[mode].unwrap() * is_same;
                assert!(
                    (product(&stiff) - value).abs() < 1e-5 * largest,
                    "{context}: {mode} {other}"
                );
            }
        }
        let mut nodes = vec![0.0_f32; layout.vector_len()];
        for (c, row) in (0..2).flat_map(|c| (0..rows).map(move |row| (c, row))) {
            for column in 1..columns - 1 {
                nodes[layout.index(c, column, row)] = ((c + 3 * row + column * column) as f32).sin();
            }
        }
        let [mut spare, mut found] = [vec![0.0; 2 * rows * width], vec![f32::NAN; 2 * rows * width]];
        transform.forward(&nodes, &mut spare, &mut found);
        let mut back = nodes.clone();
        transform.backward(&mut found.clone(), &mut spare, &mut back);
        for (c, row) in (0..2).flat_map(|c| (0..rows).map(move |row| (c, row))) {
            let found = &found[(c * rows + row) * width..][..width];
            for mode in 0..width {
                let each = (1..columns - 1).map(|at| modes[at - 1][mode] * nodes[layout.index(c, at, row)]);
                let exact: f32 = each.sum();
                assert!((found[mode] - exact).abs() < 1e-4, "{context}: {c} {row} {mode}");
            }
            for column in 1..columns - 1 {
                let exact = match row == 0 || row == rows - 1 {
                    true => nodes[layout.index(c, column, row)],
                    false => modes[column - 1].iter().zip(found).map(|(a, b)| a * b).sum(),
                };
                let value = back[layout.index(c, column, row)];
                assert!(
                    (value - exact).abs() < 1e-3 * largest.sqrt() as f32,
                    "{context}: {c} {row} {column}"
                );
            }
        }
    }

    #[test]
    fn transforms_are_products_with_the_eigenvectors() {
        for (cells, per_cell, strip) in [
            (5, 1, None),
            (6, 2, None),
            (7, 3, None),
            (4, 4, Some(0.2)),
            (5, 2, Some(0.3)),
            (6, 1, Some(0.1)),
        ] {
            for order in [Order::Bilinear, Order::Biquadratic] {
                let (mesh, sheet) = (Mesh::new(per_cell, order), sheet([cells, 2], [30.0, 20.0]));
                let grid = match strip {
                    Some(strip) => Grid::along_strips(mesh, &sheet, [strip; 2]),
                    None => Grid::uniform(mesh, &sheet),
                };
                let size = |at: usize| grid.sides([at; 2])[0];
                let (stiffness, mass) = match order {
                    Order::Bilinear => line_matrices(grid.elements()[0], &Line::LINEAR, size),
                    Order::Biquadratic => line_matrices(grid.elements()[0], &Line::QUADRATIC, size),
                };
                let (layout, context) = (grid.layout(), format!("{cells} {mesh} {strip:?}"));
                let by_cell = CellTransform::new(layout, cells, &stiffness, &mass).unwrap();
                check(&by_cell, layout, &stiffness, &mass, &context);
                let by_line = LineTransform::new(layout, &stiffness, &mass).unwrap();
                check(&by_line, layout, &stiffness, &mass, &context);
            }
        }
    }

    #[test]
    fn a_strip_takes_the_work_of_its_transpose() {
        let solved = |cells: [usize; 2], size| {
            let grid = Grid::uniform(Mesh::bilinear(2), &sheet(cells, size));
            let rectangle = Rectangle::new(&grid, 0.0).unwrap();
            (rectangle.widths()[0], rectangle.scratch().modes.len())
        };
        assert_eq!(solved([400, 1], [100.0, 0.25]), solved([1, 400], [0.25, 100.0]));
    }

    #[test]
    fn sums_over_clusters_are_those_of_the_nodes() {
        let grid = Grid::uniform(Mesh::biquadratic(2), &sheet([12, 9], [30.0, 20.0]));
        let rectangle = Rectangle::new(&grid, 0.0).unwrap();
        let layout = grid.layout();
        let places: Vec<[usize; 2]> = (1..36).map(|at| [at, 1 + at * at % 34]).collect();
        let indices: Vec<usize> = places.iter().map(|[x, y]| layout.index(0, *x, *y)).collect();
        let nodes = rectangle.nodes(&indices);
        let each = rectangle.between(0, &nodes);
        let of: Vec<usize> = (0..places.len()).map(|at| at % 7).collect();
        let sums = rectangle.between_clusters(0, &nodes, &of, 7);
        for (i, k) in (0..49).map(|at| (at / 7, at % 7)) {
            let parts = (0..places.len()).flat_map(|a| (0..places.len()).map(move |b| (a, b)));
            let own = parts.filter(|(a, b)| (of[*a], of[*b]) == (i, k));
            let exact: f64 = own.map(|(a, b)| each[(a, b)]).sum();
            assert!((sums[(i, k)] / exact - 1.0).abs() < 1e-4, "{} {exact}", sums[(i, k)]);
        }
    }
}
