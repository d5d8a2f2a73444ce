//! The layout of nodal vectors in memory.
//!
//! A vector of nodal displacements is two planes, x then y, each of `nodes` rows. A row holds first the nodes shared by
//! elements, then, for biquadratic elements, the nodes in their middle. So each node of neighbouring elements is
//! contiguous, and kernels load them without a shuffle. Both parts are padded with zeros to whole registers.

use std::ops::Range;

use deaflow_field::Order;

use super::lanes::{Real, WIDEST};

/// The sides of a membrane, in the order of `Edge`: left, right, bottom, top.
pub const SIDES: usize = 4;

/// The components of the displacement that are free on each side of the membrane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct FreeSides(u8);

impl FreeSides {
    /// Creates them from the components, along x and y, that each side holds.
    #[must_use]
    pub fn new(held: [[bool; 2]; SIDES]) -> Self {
        let bits = (0..2 * SIDES).filter(|at| !held[at / 2][at % 2]).map(|at| 1 << at);
        Self(bits.sum())
    }

    /// Returns them with x and y exchanged for places, not for components.
    #[must_use]
    pub fn exchanged(self) -> Self {
        Self(self.0.rotate_left(SIDES as u32))
    }

    /// Returns whether all sides are held.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns whether component `c` is free on the first (0) or last (1) side along an axis.
    #[inline(always)]
    #[must_use]
    pub fn has(self, axis: usize, end: usize, c: usize) -> bool {
        self.0 >> (2 * (2 * axis + end) + c) & 1 == 1
    }

    /// Returns the range of free ones among a number of nodes along an axis, for component `c`.
    #[must_use]
    pub fn range(self, axis: usize, c: usize, nodes: usize) -> Range<usize> {
        let end = |end: usize| usize::from(!self.has(axis, end, c));
        end(0)..nodes - end(1)
    }
}

/// The layout of nodal vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NodeLayout {
    elements: [usize; 2],
    degree: usize,
    /// Rows of mapped elements.
    mapped_rows: usize,
    free_sides: FreeSides,
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
            free_sides: FreeSides(0),
        }
    }

    /// Frees components on sides.
    #[must_use]
    pub const fn with_free_sides(self, free_sides: FreeSides) -> Self {
        Self { free_sides, ..self }
    }

    /// Returns the components that are free on sides.
    #[must_use]
    pub fn free_sides(&self) -> FreeSides {
        self.free_sides
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

    /// Sets what sides hold and the padding to zero.
    pub fn clear_frame<T: Real>(&self, vector: &mut [T]) {
        let (stride, elements, [_, nodes]) = (self.stride(), self.columns(), self.nodes());
        let zero = T::default();
        for (c, plane) in vector.chunks_exact_mut(nodes * stride).enumerate() {
            let free = |axis, end| self.free_sides.has(axis, end, c);
            if !free(1, 0) {
                plane[..stride].fill(zero);
            }
            if !free(1, 1) {
                plane[(nodes - 1) * stride..].fill(zero);
            }
            let [is_left_free, is_right_free] = [0, 1].map(|end| free(0, end));
            for row in plane.chunks_exact_mut(stride) {
                if !is_left_free {
                    row[0] = zero;
                }
                for (inner, part) in row.chunks_exact_mut(self.part()).enumerate() {
                    let last = elements + usize::from(is_right_free && inner == 0);
                    part[last..].fill(zero);
                }
            }
        }
    }

    /// Returns the nodes (column, row) of a side, along it; sides are counted as in [`SIDES`].
    pub fn side_nodes(&self, side: usize) -> impl Iterator<Item = [usize; 2]> + use<> {
        let (axis, nodes) = (side / 2, self.nodes());
        let across = if side.is_multiple_of(2) { 0 } else { nodes[axis] - 1 };
        (0..nodes[1 - axis]).map(move |along| if axis == 0 { [across, along] } else { [along, across] })
    }
}
