//! Where a pattern is active on a mesh, element by element.

use std::sync::Arc;

use crate::pattern::{Part, Pattern};

use super::grid::Grid;
#[cfg(doc)]
use super::layout::NodeLayout;
use super::memory::Memory;
use super::precision::{Both, Precision};

/// Where a pattern is active on a grid of elements.
#[derive(Clone, Debug)]
pub struct Activity {
    grid: Grid,
    /// Of each element, in rows of [`NodeLayout::part`] numbers.
    values: Both,
    /// The sides of each column and each row of elements; where they are not all 1.
    sides: Option<[Both; 2]>,
    /// Whether each element is active or bare, and nothing between.
    is_binary: bool,
    /// An energy beside that of the law.
    memory: Option<Arc<Memory>>,
}

impl Activity {
    /// The activity of a pattern whose electrodes all have the full load.
    #[must_use]
    pub fn new(grid: &Grid, pattern: &Pattern) -> Self {
        Self::from_shares(grid, |x, y| f64::from(u8::from(pattern.is_active(x, y))))
    }

    /// The activity of a pattern whose groups of electrodes have these shares of the load.
    ///
    /// # Panics
    /// When a cell belongs to a group that has none.
    #[must_use]
    pub fn of_groups(grid: &Grid, pattern: &Pattern, loads: &[f64]) -> Self {
        Self::from_shares(grid, |x, y| load_of(pattern.group(x, y), loads))
    }

    /// Cells (column, row) that are active to a share: what derivatives with respect to the pattern are derivatives of.
    #[must_use]
    pub fn from_shares(grid: &Grid, share: impl Fn(usize, usize) -> f64) -> Self {
        let layout = grid.layout();
        let mut values = vec![0.0; layout.rows() * layout.part()];
        grid.write_activity(&share, &mut values);
        Self::of_values(grid, values)
    }

    /// Elements (column, row) that are active to a share.
    #[must_use]
    pub fn from_elements(grid: &Grid, share: impl Fn(usize, usize) -> f64) -> Self {
        let layout = grid.layout();
        let mut values = vec![0.0; layout.rows() * layout.part()];
        for (row, shares) in values.chunks_exact_mut(layout.part()).enumerate() {
            let elements = shares[..layout.columns()].iter_mut().enumerate();
            elements.for_each(|(column, value)| *value = share(column, row));
        }
        Self::of_values(grid, values)
    }

    fn of_values(grid: &Grid, mut values: Vec<f64>) -> Self {
        let layout = grid.layout();
        let [columns, rows] = grid.elements();
        // Nothing is electric in frames and bodies.
        if let Some(parts) = grid.parts() {
            let [along, across] = grid.per_cell();
            for (row, elements) in values.chunks_exact_mut(layout.part()).enumerate() {
                for (column, value) in elements[..columns].iter_mut().enumerate() {
                    if parts.at(column / along, row / across) != Part::Membrane {
                        *value = 0.0;
                    }
                }
            }
        }
        // Beyond the last element 1, by which kernels divide.
        let width = |at: usize| if at < columns { grid.sides([at, 0])[0] } else { 1.0 };
        let widths = || Both::new((0..layout.part()).map(width).collect());
        let heights = || Both::new((0..rows).map(|at| grid.sides([0, at])[1]).collect());
        Self {
            grid: grid.clone(),
            is_binary: values.iter().all(|value| *value == 0.0 || *value == 1.0),
            values: Both::new(values),
            sides: (!grid.is_plain()).then(|| [widths(), heights()]),
            memory: None,
        }
    }

    /// The same with an energy beside that of the law.
    #[must_use]
    pub fn with_memory(&self, memory: Memory) -> Self {
        Self {
            memory: Some(Arc::new(memory)),
            ..self.clone()
        }
    }

    /// The room of an energy beside that of the law, if there is one and nobody else looks at it.
    #[must_use]
    pub fn into_memory(self) -> Option<Memory> {
        Arc::into_inner(self.memory?)
    }

    /// An energy beside that of the law.
    #[must_use]
    pub fn memory(&self) -> Option<&Memory> {
        self.memory.as_deref()
    }

    /// Whether each element is active or bare, and nothing between.
    #[must_use]
    pub fn is_binary(&self) -> bool {
        self.is_binary
    }

    /// The elements.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The activity of each element, in rows of [`NodeLayout::part`] numbers.
    #[must_use]
    pub fn elements(&self) -> &[f64] {
        self.values.double()
    }

    /// The active area of an element (column, row), in units of the mean area of elements.
    #[must_use]
    pub fn area(&self, [column, row]: [usize; 2]) -> f64 {
        let share = self.values.double()[row * self.grid.layout().part() + column];
        share * self.grid.size(0, column) * self.grid.size(1, row)
    }

    /// What kernels read.
    #[must_use]
    pub(super) fn view<T: Precision>(&self) -> View<'_, T> {
        View {
            values: T::of(&self.values),
            sides: self
                .sides
                .as_ref()
                .map(|[widths, heights]| [T::of(widths), T::of(heights)]),
            is_uniform: self.grid.is_uniform(),
            memory: self.memory().map(|memory| (memory.view(), memory.weight)),
        }
    }
}

/// The share of the load that a group of electrodes has; none of what is bare.
///
/// # Panics
/// When the group has none.
#[must_use]
pub fn load_of(group: u8, loads: &[f64]) -> f64 {
    match group {
        0 => 0.0,
        _ => loads[usize::from(group) - 1],
    }
}

/// An activity in one precision; the fields are those of [`Activity`].
#[derive(Clone, Copy)]
pub(super) struct View<'a, T> {
    pub values: &'a [T],
    pub sides: Option<[&'a [T]; 2]>,
    /// Whether all elements have the same sides.
    pub is_uniform: bool,
    /// The coefficients of an energy beside that of the law, and their [`Memory::weight`].
    pub memory: Option<(&'a [T], f64)>,
}
