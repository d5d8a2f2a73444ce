//! How the vectors of a mesh lie in memory.
//!
//! A vector of nodal displacements is two planes, x then y, each of `nodes` rows. A row holds the nodes that elements
//! share first, then, for biquadratic elements, the nodes in their middle: so neighbouring elements find each of their
//! nodes side by side, and a kernel reads them without a shuffle. Both parts are padded to whole registers with zeros.

use deaflow_base::Stream;
use deaflow_field::{Field, Order};

use super::grid::Grid;
use super::lanes::{Real, WIDEST};

/// How vectors of a grid lie in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NodeLayout {
    elements: [usize; 2],
    degree: usize,
}

impl NodeLayout {
    /// For so many columns and rows of elements.
    #[must_use]
    pub const fn new(elements: [usize; 2], order: Order) -> Self {
        let degree = match order {
            Order::Bilinear => 1,
            Order::Biquadratic => 2,
        };
        Self { elements, degree }
    }

    /// Columns of elements.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.elements[0]
    }

    /// Rows of elements.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.elements[1]
    }

    /// Polynomial degree.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Nodes along x and y, frame included.
    #[inline(always)]
    #[must_use]
    pub fn nodes(&self) -> [usize; 2] {
        let [columns, rows] = self.elements;
        [columns * self.degree + 1, rows * self.degree + 1]
    }

    /// All elements (column, row), row by row.
    pub fn each_element(self) -> impl Iterator<Item = [usize; 2]> {
        let [columns, rows] = self.elements;
        (0..rows).flat_map(move |row| (0..columns).map(move |column| [column, row]))
    }

    /// Numbers in a part of a row: the shared nodes, or those in the middle of elements.
    #[inline(always)]
    #[must_use]
    pub fn part(&self) -> usize {
        (self.columns() + 1).next_multiple_of(WIDEST)
    }

    /// Numbers in a row of a vector.
    #[inline(always)]
    #[must_use]
    pub fn stride(&self) -> usize {
        self.degree * self.part()
    }

    /// Numbers in a vector.
    #[must_use]
    pub fn vector_len(&self) -> usize {
        2 * self.nodes()[1] * self.stride()
    }

    /// Where component `c` of the node at (column, row) lies in a vector.
    #[must_use]
    pub fn index(&self, c: usize, column: usize, row: usize) -> usize {
        self.index_in(c, column / self.degree, column % self.degree, row)
    }

    /// Where component `c` of the node at a row lies that is the one with the number `inner` from the left of an element, less than the degree.
    #[inline(always)]
    #[must_use]
    pub fn index_in(&self, c: usize, element: usize, inner: usize, row: usize) -> usize {
        (c * self.nodes()[1] + row) * self.stride() + inner * self.part() + element
    }

    /// Sets everything on the frame and beyond the last node to zero.
    pub fn clear_frame<T: Real>(&self, vector: &mut [T]) {
        let (stride, elements, [_, nodes]) = (self.stride(), self.columns(), self.nodes());
        let zero = T::default();
        for plane in vector.chunks_exact_mut(nodes * stride) {
            plane[..stride].fill(zero);
            plane[(nodes - 1) * stride..].fill(zero);
            for row in plane.chunks_exact_mut(stride) {
                row[0] = zero;
                row.chunks_exact_mut(self.part())
                    .for_each(|part| part[elements..].fill(zero));
            }
        }
    }
}

impl Grid {
    /// Writes the activity of each element, that of its cell (column, row), in rows of [`NodeLayout::part`] numbers.
    pub fn write_activity<T: Real>(&self, share: impl Fn(usize, usize) -> f64, activity: &mut [T]) {
        let (layout, [along, across]) = (self.layout(), self.per_cell());
        let part = layout.part();
        for (cell_row, rows) in activity.chunks_exact_mut(across * part).enumerate() {
            let (first, others) = rows.split_at_mut(part);
            for (cell, elements) in first[..layout.columns()].chunks_exact_mut(along).enumerate() {
                elements.fill(T::from_f64(share(cell, cell_row)));
            }
            others.chunks_exact_mut(part).for_each(|row| row.copy_from_slice(first));
        }
    }

    /// Where component `c` of the displacement of the corner of cells at (column, row) lies in a vector.
    fn corner(&self, c: usize, column: usize, row: usize) -> usize {
        let layout = self.layout();
        let [along, across] = self.per_cell().map(|count| count * layout.degree());
        layout.index(c, column * along, row * across)
    }

    /// The transpose of sampling at a displacement `u`: forces at the cell corners as nodal forces.
    #[must_use]
    pub fn spread(&self, corners: &Field, u: &[f64]) -> Vec<f64> {
        let (layout, [columns, _]) = (self.layout(), self.raster().corner_sides());
        let mut vector = vec![0.0; layout.vector_len()];
        for (at, value) in corners.values().iter().enumerate() {
            let (c, x, y) = (at % 2, at / 2 % columns, at / 2 / columns);
            vector[self.corner(c, x, y)] = *value;
        }
        self.restrict(u, &mut vector);
        vector
    }

    /// Random nodal forces at a displacement `u`, which have a part along every mode: normal deviates at the cell corners, or at all nodes
    /// where these may all be held.
    #[must_use]
    pub fn random_load(&self, stream: &mut Stream, u: &[f64]) -> Vec<f64> {
        if self.raster().sides().contains(&1) || self.supports().is_some() {
            let mut vector: Vec<f64> = (0..self.layout().vector_len()).map(|_| stream.normal()).collect();
            self.restrict(u, &mut vector);
            return vector;
        }
        let forces = (0..self.raster().corners() * 2).map(|_| stream.normal()).collect();
        self.spread(
            &Field::from_values(self.raster(), forces).expect("normal deviates are finite"),
            u,
        )
    }

    /// The displacement at the cell corners in mm, from nodal values in units of [`Grid::unit_mm`].
    #[must_use]
    pub fn sample(&self, vector: &[f64]) -> Field {
        let [columns, rows] = self.raster().corner_sides();
        let mut values = Vec::with_capacity(self.raster().corners() * 2);
        for y in 0..rows {
            for x in 0..columns {
                for c in 0..2 {
                    values.push(self.unit_mm() * vector[self.corner(c, x, y)]);
                }
            }
        }
        Field::from_values(self.raster(), values).expect("a solution is finite")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sheet::Sheet;
    use deaflow_field::Mesh;
    use deaflow_pattern::{Membrane, Raster};

    fn grid(mesh: Mesh) -> Grid {
        let membrane = Membrane {
            raster: Raster::new(50, 32).unwrap(),
            size_mm: [50.0, 8.0],
        };
        let sheet = Sheet {
            membrane,
            ..Sheet::paper()
        };
        Grid::uniform(mesh, &sheet)
    }

    #[test]
    fn activity_follows_the_cells() {
        let grid = grid(Mesh::bilinear(3));
        let (layout, width) = (grid.layout(), grid.layout().part());
        let mut activity = vec![0.0; layout.rows() * width];
        grid.write_activity(|x, y| if (x, y) == (49, 7) { 1.0 } else { 0.0 }, &mut activity);
        assert_eq!(activity.iter().sum::<f64>(), 9.0);
        assert_eq!(activity[22 * width + 148], 1.0);
    }

    #[test]
    fn sampling_picks_the_corners_of_the_cells() {
        for order in [Order::Bilinear, Order::Biquadratic] {
            let grid = grid(Mesh::new(2, order));
            let layout = grid.layout();
            let mut vector = vec![0.0; layout.vector_len()];
            let step = 2 * order.degree();
            vector[layout.index(1, 7 * step, 30 * step)] = 4.0;
            // √(½ · ⅛) mm
            assert_eq!(grid.sample(&vector).at_corner(7, 30), [0.0, 1.0]);
            let spread = grid.spread(&grid.sample(&vector), &vector);
            assert_eq!(spread[layout.index(1, 7 * step, 30 * step)], 1.0);
            assert_eq!(spread.iter().sum::<f64>(), 1.0);
        }
    }
}
