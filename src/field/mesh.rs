//! Uniform meshes, by the number of elements per cell and their order.

use std::fmt;

/// Polynomial order of the elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Order {
    /// Four nodes, order of convergence 2 for smooth solutions.
    Bilinear,
    /// Nine nodes, order of convergence 3 for smooth solutions.
    Biquadratic,
}

impl Order {
    /// Returns the degree, 1 or 2.
    #[must_use]
    pub fn degree(self) -> usize {
        match self {
            Self::Bilinear => 1,
            Self::Biquadratic => 2,
        }
    }
}

/// The number of elements along the side of a cell, and their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Mesh {
    elements_per_cell: usize,
    order: Order,
}

impl Mesh {
    /// The largest number of elements along the side of a cell.
    pub const MOST_ELEMENTS: usize = 8;

    /// Creates a mesh from the number of elements along the side of a cell and their order.
    #[must_use]
    pub const fn new(elements_per_cell: usize, order: Order) -> Self {
        Self {
            elements_per_cell,
            order,
        }
    }

    /// Creates a mesh of bilinear elements.
    #[must_use]
    pub const fn bilinear(elements_per_cell: usize) -> Self {
        Self::new(elements_per_cell, Order::Bilinear)
    }

    /// Creates a mesh of biquadratic elements.
    #[must_use]
    pub const fn biquadratic(elements_per_cell: usize) -> Self {
        Self::new(elements_per_cell, Order::Biquadratic)
    }

    /// Reads a mesh from numbers in a file: 1 to 8 elements along the side of a cell, and order 1 or 2.
    #[must_use]
    pub fn from_numbers(elements_per_cell: u64, order: u64) -> Option<Self> {
        let order = match order {
            1 => Order::Bilinear,
            2 => Order::Biquadratic,
            _ => return None,
        };
        let mesh = Self::new(usize::try_from(elements_per_cell).ok()?, order);
        mesh.is_solvable().then_some(mesh)
    }

    /// Returns whether there are 1 to [`Mesh::MOST_ELEMENTS`] elements along the side of a cell, as solvers need.
    #[must_use]
    pub fn is_solvable(&self) -> bool {
        (1..=Self::MOST_ELEMENTS).contains(&self.elements_per_cell)
    }

    /// The polynomial order.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    /// The number of elements along the side of a cell.
    #[must_use]
    pub fn elements_per_cell(&self) -> usize {
        self.elements_per_cell
    }

    /// Returns the relative work for a pattern, by the number of unknowns. Biquadratic elements have four times as many
    /// and couple each to more.
    #[must_use]
    pub fn weight(&self) -> f64 {
        let factor = if self.order == Order::Biquadratic { 6.0 } else { 1.0 };
        factor * (self.elements_per_cell as f64).powi(2)
    }

    /// Returns a finer mesh to estimate the error of this one: biquadratic instead of bilinear elements, or biquadratic
    /// elements of half the size; `None` for the finest mesh. Its own error is an eighth to a third of the error here
    /// (docs/accuracy.md).
    #[must_use]
    pub fn finer(self) -> Option<Self> {
        let finer = match self.order {
            Order::Bilinear => Self::biquadratic(self.elements_per_cell),
            Order::Biquadratic => Self::biquadratic((2 * self.elements_per_cell).min(Self::MOST_ELEMENTS)),
        };
        (finer != self).then_some(finer)
    }

    /// Returns the cost of a solution relative to one bilinear element per cell. A biquadratic element costs as much as
    /// five bilinear ones (docs/performance.md).
    #[must_use]
    pub fn cost(self) -> u64 {
        let element = match self.order {
            Order::Bilinear => 1,
            Order::Biquadratic => 5,
        };
        element * (self.elements_per_cell as u64).pow(2)
    }
}

/// Formats the keys of a stage for this mesh, on one line without braces.
impl fmt::Display for Mesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "elements_per_cell: {}, order: {}",
            self.elements_per_cell,
            self.order.degree()
        )
    }
}
