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
use super::modes::line_matrices;
use deaflow_field::Order;

/// Ratio of columns to rows of nodes above which transforms are along y. They cost as much as the product of the number
/// of nodes and that of nodes along their direction.
const LONG: usize = 3;

/// Number of cells along the transforms above which they make use of the period of the cells.
const MANY_CELLS: usize = 100;

/// Returns whether rows of many cells are transformed on a raster with these columns and rows, or columns and rows may
/// be exchanged. Results then differ in their last digits from those of earlier versions.
pub(super) fn is_large_or_long([columns, rows]: [usize; 2]) -> bool {
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

/// The inverse Laplacian of the full rectangle, with zero values on its edge.
pub(super) struct Rectangle {
    /// Layout of the vectors.
    given: NodeLayout,
    /// Layout with transforms along rows: that of the vectors, or with columns and rows exchanged.
    layout: NodeLayout,
    transform: Box<dyn Transform>,
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
    /// A vector with columns and rows exchanged; empty if they are not.
    exchanged: Vec<f32>,
    folded: Vec<f32>,
    modes: Vec<f32>,
}

impl Rectangle {
    pub(super) fn new(grid: &Grid, mass_factor: f64) -> Result<Self, SetupError> {
        // Mapped elements are no part of vectors.
        let given = NodeLayout::new(grid.elements(), grid.order());
        let [columns, rows] = given.nodes();
        let axes = if columns > LONG * rows { [1, 0] } else { [0, 1] };
        let layout = NodeLayout::new(axes.map(|axis| grid.elements()[axis]), grid.order());
        let [(stiffness, mass), columns] = axes.map(|axis| {
            let size = |at: usize| grid.sides([at; 2])[axis];
            match grid.order() {
                Order::Bilinear => line_matrices(grid.elements()[axis], &Line::LINEAR, size),
                Order::Biquadratic => line_matrices(grid.elements()[axis], &Line::QUADRATIC, size),
            }
        });
        let [cells, _] = axes.map(|axis| grid.raster().sides()[axis]);
        let transform: Box<dyn Transform> = match cells > MANY_CELLS {
            true => Box::new(CellTransform::new(layout, cells, &stiffness, &mass)?),
            false => Box::new(LineTransform::new(layout, &stiffness, &mass)?),
        };
        let values = transform.values().into_iter();
        let values: Vec<f64> = values
            .map(|value| value.map_or(1.0, |value| value + mass_factor))
            .collect();
        Ok(Self {
            given,
            layout,
            columns: Columns::new(layout, &columns, &values),
            transform,
        })
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
        let node = |index: &usize| {
            let [column, row] = self.place(*index);
            (row, self.transform.modes_at(column))
        };
        let (rows, modes): (Vec<usize>, Vec<Vec<f32>>) = indices.iter().map(node).unzip();
        ModalNodes {
            rows,
            modes: modes.concat(),
        }
    }

    /// Returns the inverse between some nodes: sums over the modes along x of solutions along y for a load on each row.
    pub(super) fn between(&self, nodes: &ModalNodes) -> Mat<f64> {
        let width = self.transform.width();
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
            self.columns.solve(&mut plane);
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

    /// Returns sums of the inverse over the nodes of clusters: `of` is the cluster of each node. Modes along x are left
    /// out at distances along y over which their response to a load has decayed to rounding.
    pub(super) fn between_clusters(&self, nodes: &ModalNodes, of: &[usize], count: usize) -> Mat<f64> {
        let width = self.transform.width();
        // The modes of the nodes of a cluster on one row, added up.
        let mut by_row: BTreeMap<usize, BTreeMap<usize, Vec<f32>>> = BTreeMap::new();
        for (at, (row, cluster)) in nodes.rows.iter().zip(of).enumerate() {
            let sum = by_row.entry(*row).or_default().entry(*cluster);
            let sum = sum.or_insert_with(|| vec![0.0; width]);
            add_scaled(sum, 1.0, nodes.modes_of(at, width));
        }
        let mut plane = vec![0.0_f32; self.layout.nodes()[1] * width];
        let mut weighted = vec![0.0_f32; width];
        let mut matrix = Mat::zeros(count, count);
        for (&row, loaded) in &by_row {
            let ends = self.columns.respond(row, &mut plane);
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
        let len = 2 * self.layout.nodes()[1] * self.transform.width();
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
        let width = self.transform.width();
        let plane = self.layout.nodes()[1] * width;
        self.solve_with(r, z, scratch, |forces, modes| {
            modes.copy_from_slice(forces);
            self.columns.solve(modes);
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
        let RectangleScratch {
            exchanged,
            folded,
            modes,
        } = scratch;
        let is_exchanged = self.is_exchanged();
        if is_exchanged {
            exchange([self.given, self.layout], r, exchanged);
        }
        self.transform
            .forward(if is_exchanged { exchanged } else { r }, folded, modes);
        change(modes, folded);
        self.columns.solve(modes);
        if is_exchanged {
            self.transform.backward(modes, folded, exchanged);
            exchange([self.layout, self.given], exchanged, z);
        } else {
            self.transform.backward(modes, folded, z);
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

/// Copies the interior of a vector to one with columns and rows exchanged.
fn exchange([from, to]: [NodeLayout; 2], source: &[f32], target: &mut [f32]) {
    let (degree, [columns, rows]) = (from.degree(), from.nodes());
    for (c, row) in (0..2).flat_map(|c| (1..rows - 1).map(move |row| (c, row))) {
        let (first, step) = (to.index(c, row, 0), to.stride());
        for inner in 0..degree {
            let start = from.index_in(c, 0, inner, row);
            let nodes = (inner..columns).step_by(degree).zip(&source[start..]);
            let inside = nodes.filter(|(column, _)| (1..columns - 1).contains(column));
            inside.for_each(|(column, value)| target[first + column * step] = *value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
            (rectangle.transform.width(), rectangle.scratch().modes.len())
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
        let each = rectangle.between(&nodes);
        let of: Vec<usize> = (0..places.len()).map(|at| at % 7).collect();
        let sums = rectangle.between_clusters(&nodes, &of, 7);
        for (i, k) in (0..49).map(|at| (at / 7, at % 7)) {
            let parts = (0..places.len()).flat_map(|a| (0..places.len()).map(move |b| (a, b)));
            let own = parts.filter(|(a, b)| (of[*a], of[*b]) == (i, k));
            let exact: f64 = own.map(|(a, b)| each[(a, b)]).sum();
            assert!((sums[(i, k)] / exact - 1.0).abs() < 1e-4, "{} {exact}", sums[(i, k)]);
        }
    }
}
