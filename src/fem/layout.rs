//! The layout of nodal vectors in memory.
//!
//! A vector of nodal displacements is two planes, x then y, each of `nodes` rows. A row holds first the nodes shared by
//! elements, then, for biquadratic elements, the nodes in their middle. So each node of neighbouring elements is
//! contiguous, and kernels load them without a shuffle. Both parts are padded with zeros to whole registers.

use deaflow_field::Order;

use super::lanes::{Real, WIDEST};

/// The layout of nodal vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NodeLayout {
    elements: [usize; 2],
    degree: usize,
    /// Rows of mapped elements.
    mapped_rows: usize,
}

impl NodeLayout {
    /// Creates the layout for numbers of columns and rows of elements.
    #[must_use]
    pub const fn new(elements: [usize; 2], order: Order) -> Self {
        let degree = match order {
            Order::Bilinear => 1,
            Order::Biquadratic => 2,
        };
        Self {
            elements,
            degree,
            mapped_rows: 0,
        }
    }

    /// Adds rows of mapped elements after those of the grid.
    #[must_use]
    pub const fn with_mapped_rows(self, mapped_rows: usize) -> Self {
        Self { mapped_rows, ..self }
    }

    /// Returns the number of rows of elements, with those of mapped elements.
    #[inline(always)]
    #[must_use]
    pub fn element_rows(&self) -> usize {
        self.elements[1] + self.mapped_rows
    }

    /// Returns the number of columns of elements.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.elements[0]
    }

    /// Returns the number of rows of elements.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.elements[1]
    }

    /// Returns the polynomial degree.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Returns the number of nodes along x and y, including the frame.
    #[inline(always)]
    #[must_use]
    pub fn nodes(&self) -> [usize; 2] {
        let [columns, rows] = self.elements;
        [columns * self.degree + 1, rows * self.degree + 1]
    }

    /// Returns all elements (column, row), row by row.
    pub fn each_element(self) -> impl Iterator<Item = [usize; 2]> {
        let [columns, rows] = self.elements;
        (0..rows).flat_map(move |row| (0..columns).map(move |column| [column, row]))
    }

    /// Returns the length of a part of a row: the shared nodes, or those in the middle of elements.
    #[inline(always)]
    #[must_use]
    pub fn part(&self) -> usize {
        (self.columns() + 1).next_multiple_of(WIDEST)
    }

    /// Returns the length of a row.
    #[inline(always)]
    #[must_use]
    pub fn stride(&self) -> usize {
        self.degree * self.part()
    }

    /// Returns the length of a vector.
    #[must_use]
    pub fn vector_len(&self) -> usize {
        2 * self.nodes()[1] * self.stride()
    }

    /// Returns the index of component `c` of the node at (column, row).
    #[must_use]
    pub fn index(&self, c: usize, column: usize, row: usize) -> usize {
        self.index_in(c, column / self.degree, column % self.degree, row)
    }

    /// Returns the index for the first component of a node of an element (column, row), counted row by row.
    #[must_use]
    pub fn node_of(&self, [column, row]: [usize; 2], node: usize) -> usize {
        let side = self.degree + 1;
        self.index(0, column * self.degree + node % side, row * self.degree + node / side)
    }

    /// Returns the index of component `c` of the node number `inner`, less than the degree, from the left of an
    /// element.
    #[inline(always)]
    #[must_use]
    pub fn index_in(&self, c: usize, element: usize, inner: usize, row: usize) -> usize {
        (c * self.nodes()[1] + row) * self.stride() + inner * self.part() + element
    }

    /// Sets the frame and the padding to zero.
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
