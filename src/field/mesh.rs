//! How finely the cells of a membrane are divided into elements.

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
    /// 1 or 2.
    #[must_use]
    pub fn degree(self) -> usize {
        match self {
            Self::Bilinear => 1,
            Self::Biquadratic => 2,
        }
    }
}

/// A whole number of elements along the sides of each cell, and their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Mesh {
    elements_per_cell: usize,
    order: Order,
}

impl Mesh {
    /// Most elements along the side of a cell that solvers take; the least is one.
    pub const MOST_ELEMENTS: usize = 8;

    /// The mesh with so many elements along the side of a cell.
    #[must_use]
    pub const fn new(elements_per_cell: usize, order: Order) -> Self {
        Self {
            elements_per_cell,
            order,
        }
    }

    /// The mesh with so many bilinear elements along the side of a cell.
    #[must_use]
    pub const fn bilinear(elements_per_cell: usize) -> Self {
        Self::new(elements_per_cell, Order::Bilinear)
    }

    /// The mesh with so many biquadratic elements along the side of a cell.
    #[must_use]
    pub const fn biquadratic(elements_per_cell: usize) -> Self {
        Self::new(elements_per_cell, Order::Biquadratic)
    }

    /// The mesh that two numbers in a file name, 1 to 8 elements along the side of a cell and their order, 1 or 2.
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

    /// Whether solvers take it: 1 to [`Mesh::MOST_ELEMENTS`] elements along the side of a cell.
    #[must_use]
    pub fn is_solvable(&self) -> bool {
        (1..=Self::MOST_ELEMENTS).contains(&self.elements_per_cell)
    }

    /// Polynomial order.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    /// Elements along one side of a cell.
    #[must_use]
    pub fn elements_per_cell(&self) -> usize {
        self.elements_per_cell
    }

    /// The mesh by which errors on this one are told: biquadratic instead of bilinear, or half the size of biquadratic;
    /// `None` for the finest. What it leaves is an eighth to a third of the error here (docs/accuracy.md).
    #[must_use]
    pub fn finer(self) -> Option<Self> {
        let finer = match self.order {
            Order::Bilinear => Self::biquadratic(self.elements_per_cell),
            Order::Biquadratic => Self::biquadratic((2 * self.elements_per_cell).min(Self::MOST_ELEMENTS)),
        };
        (finer != self).then_some(finer)
    }

    /// What a solution costs, in solutions with one bilinear element per cell. A biquadratic element costs as much as
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

/// The keys of a stage that asks for it, on one line without braces.
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
