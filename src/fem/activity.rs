//! Where a pattern is active on a mesh, element by element.

use crate::pattern::Pattern;

use super::grid::Grid;
use super::lanes::Real;

/// Numbers in both precisions.
#[derive(Clone, Debug, PartialEq)]
pub struct Both {
    double: Vec<f64>,
    single: Vec<f32>,
}

impl Both {
    fn new(double: Vec<f64>) -> Self {
        let single = double.iter().map(|&value| value as f32).collect();
        Self { double, single }
    }
}

/// A precision that operators work in.
pub trait Precision: Real {
    /// The numbers in this precision.
    fn of(both: &Both) -> &[Self];
}

impl Precision for f64 {
    fn of(both: &Both) -> &[Self] {
        &both.double
    }
}

impl Precision for f32 {
    fn of(both: &Both) -> &[Self] {
        &both.single
    }
}

/// Where a pattern is active on a grid of elements.
#[derive(Clone, Debug)]
pub struct Activity {
    grid: Grid,
    /// Of each element, in rows of [`crate::field::Mesh::part`] numbers.
    values: Both,
    /// The size of each column or row of elements; where they differ.
    sizes: Option<Both>,
}

impl Activity {
    /// The activity of a pattern; a mesh has elements of one size.
    #[must_use]
    pub fn new(grid: impl Into<Grid>, pattern: &Pattern) -> Self {
        let share = |x: usize, y: usize| f64::from(u8::from(pattern.is_active(x, y)));
        Self::from_shares(grid.into(), share)
    }

    /// Cells (column, row) that are active to a share: what derivatives with respect to the pattern are derivatives of.
    #[must_use]
    pub fn from_shares(grid: Grid, share: impl Fn(usize, usize) -> f64) -> Self {
        let mut values = vec![0.0; grid.mesh().elements() * grid.mesh().part()];
        grid.mesh().write_activity(&share, &mut values);
        Self::of_values(grid, values)
    }

    /// Elements (column, row) that are active to a share.
    #[must_use]
    pub fn from_elements(grid: Grid, share: impl Fn(usize, usize) -> f64) -> Self {
        let (elements, part) = (grid.mesh().elements(), grid.mesh().part());
        let mut values = vec![0.0; elements * part];
        for (row, shares) in values.chunks_exact_mut(part).enumerate() {
            let elements = shares[..elements].iter_mut().enumerate();
            elements.for_each(|(column, value)| *value = share(column, row));
        }
        Self::of_values(grid, values)
    }

    fn of_values(grid: Grid, values: Vec<f64>) -> Self {
        let mesh = grid.mesh();
        // Beyond the last element 1, by which kernels divide.
        let size = |at: usize| if at < mesh.elements() { grid.size(at) } else { 1.0 };
        let sizes = || Both::new((0..mesh.part()).map(size).collect());
        Self {
            grid,
            values: Both::new(values),
            sizes: (!grid.is_uniform()).then(sizes),
        }
    }

    /// The elements.
    #[must_use]
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// The activity of each element, in rows of [`crate::field::Mesh::part`] numbers.
    #[must_use]
    pub fn elements(&self) -> &[f64] {
        &self.values.double
    }

    /// The active area of an element (column, row), in squares of the mean side of elements.
    #[must_use]
    pub fn area(&self, [column, row]: [usize; 2]) -> f64 {
        let share = self.values.double[row * self.grid.mesh().part() + column];
        share * self.grid.size(column) * self.grid.size(row)
    }

    /// What kernels read.
    #[must_use]
    pub(super) fn view<T: Precision>(&self) -> View<'_, T> {
        View {
            values: T::of(&self.values),
            sizes: self.sizes.as_ref().map(T::of),
        }
    }
}

/// An activity in one precision; the fields are those of [`Activity`].
#[derive(Clone, Copy)]
pub(super) struct View<'a, T> {
    pub values: &'a [T],
    pub sizes: Option<&'a [T]>,
}
