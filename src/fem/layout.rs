//! How the vectors of a mesh lie in memory.
//!
//! A vector of nodal displacements is two planes, x then y, each of `nodes` rows. A row holds the nodes that elements
//! share first, then, for biquadratic elements, the nodes in their middle: so neighbouring elements find each of their
//! nodes side by side, and a kernel reads them without a shuffle. Both parts are padded to whole registers with zeros.

use crate::field::{CORNERS, Field, Mesh};

use super::lanes::{Real, WIDEST};

/// How vectors of a mesh lie in memory.
impl Mesh {
    /// Numbers in a part of a row: the shared nodes, or those in the middle of elements.
    #[must_use]
    pub fn part(&self) -> usize {
        (self.elements() + 1).next_multiple_of(WIDEST)
    }

    /// Numbers in a row of a vector.
    #[must_use]
    pub fn stride(&self) -> usize {
        self.order().degree() * self.part()
    }

    /// Numbers in a vector.
    #[must_use]
    pub fn vector_len(&self) -> usize {
        2 * self.nodes() * self.stride()
    }

    /// Where component `c` of the node at (column, row) lies in a vector.
    #[must_use]
    pub fn index(&self, c: usize, column: usize, row: usize) -> usize {
        let degree = self.order().degree();
        (c * self.nodes() + row) * self.stride() + column % degree * self.part() + column / degree
    }

    /// Sets everything on the frame and beyond the last node to zero.
    pub fn clear_frame<T: Real>(&self, vector: &mut [T]) {
        let (stride, elements) = (self.stride(), self.elements());
        let zero = T::default();
        for plane in vector.chunks_exact_mut(self.nodes() * stride) {
            plane[..stride].fill(zero);
            plane[(self.nodes() - 1) * stride..].fill(zero);
            for row in plane.chunks_exact_mut(stride) {
                row[0] = zero;
                row.chunks_exact_mut(self.part())
                    .for_each(|part| part[elements..].fill(zero));
            }
        }
    }

    /// Writes the activity of each element, that of its cell (column, row), in rows of [`Mesh::part`] numbers.
    pub fn write_activity<T: Real>(&self, share: impl Fn(usize, usize) -> f64, activity: &mut [T]) {
        let (per_cell, part) = (self.elements_per_cell(), self.part());
        for (cell_row, rows) in activity.chunks_exact_mut(per_cell * part).enumerate() {
            let (first, others) = rows.split_at_mut(part);
            for (cell, elements) in first[..self.elements()].chunks_exact_mut(per_cell).enumerate() {
                elements.fill(T::from_f64(share(cell, cell_row)));
            }
            others.chunks_exact_mut(part).for_each(|row| row.copy_from_slice(first));
        }
    }

    /// The transpose of sampling: forces at the cell corners as nodal forces.
    #[must_use]
    pub fn spread(&self, corners: &Field) -> Vec<f64> {
        let step = self.elements_per_cell() * self.order().degree();
        let mut vector = vec![0.0; self.vector_len()];
        for (at, value) in corners.values().iter().enumerate() {
            let (c, x, y) = (at % 2, at / 2 % CORNERS, at / 2 / CORNERS);
            vector[self.index(c, x * step, y * step)] = *value;
        }
        self.clear_frame(&mut vector);
        vector
    }

    /// The displacement at the cell corners in mm, from nodal values in units of the element's side.
    #[must_use]
    pub fn sample(&self, vector: &[f64], element_side_mm: f64) -> Field {
        let step = self.elements_per_cell() * self.order().degree();
        let mut values = Vec::with_capacity(CORNERS * CORNERS * 2);
        for y in 0..CORNERS {
            for x in 0..CORNERS {
                for c in 0..2 {
                    values.push(element_side_mm * vector[self.index(c, x * step, y * step)]);
                }
            }
        }
        Field::from_values(values).expect("a solution is finite")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::Order;

    #[test]
    fn activity_follows_the_cells() {
        let mesh = Mesh::new(3, Order::Bilinear);
        let width = mesh.part();
        let mut activity = vec![0.0; mesh.elements() * width];
        mesh.write_activity(|x, y| if (x, y) == (49, 7) { 1.0 } else { 0.0 }, &mut activity);
        assert_eq!(activity.iter().sum::<f64>(), 9.0);
        assert_eq!(activity[22 * width + 148], 1.0);
    }

    #[test]
    fn sampling_picks_the_corners_of_the_cells() {
        for order in [Order::Bilinear, Order::Biquadratic] {
            let mesh = Mesh::new(2, order);
            let mut vector = vec![0.0; mesh.vector_len()];
            let step = 2 * order.degree();
            vector[mesh.index(1, 7 * step, 30 * step)] = 4.0;
            assert_eq!(mesh.sample(&vector, 0.5).at_corner(7, 30), [0.0, 2.0]);
        }
    }
}
