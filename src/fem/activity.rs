//! Where a pattern is active on a mesh, element by element.
//!
//! Electrodes whose edges lie within elements, as a fringe field has them, are told of point by point: the activities of the points of an
//! element are such that the integral over it of activity times any function of the degree of its gradients is exact, and so are the forces
//! of the voltage at rest. Near an edge they may be a little below 0, or above what the strongest electrode there has.

use std::sync::Arc;

use pulp::Simd;

use deaflow_pattern::Pattern;

use super::grid::Grid;
use super::lanes::{Value, Wide};
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
    /// Of each of its points, where they differ.
    points: Option<Arc<Points>>,
    /// Whether each element is active or bare, and nothing between.
    is_binary: bool,
    /// An energy beside that of the law.
    memory: Option<Arc<Memory>>,
}

/// Activities within elements.
#[derive(Debug)]
struct Points {
    /// Of each point, in lines of [`NodeLayout::part`] numbers for the points of each row of elements.
    values: Both,
    /// The most that an electrode in the element has.
    strongest: Both,
}

/// What the points of an element are active to, and what the strongest electrode in it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Within<const N: usize> {
    /// Of each point.
    pub points: [f64; N],
    /// Of the strongest electrode.
    pub strongest: f64,
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
        for [column, row] in layout.each_element() {
            values[row * layout.part() + column] = share(column, row);
        }
        Self::of_values(grid, values)
    }

    /// Elements (column, row) whose points, of these weights, differ.
    #[must_use]
    pub fn from_points<const N: usize>(
        grid: &Grid,
        weights: [f64; N],
        within: impl Fn(usize, usize) -> Within<N>,
    ) -> Self {
        let (layout, part) = (grid.layout(), grid.layout().part());
        let zeros = || vec![0.0; layout.rows() * part];
        let (mut values, mut strongest, mut points) = (zeros(), zeros(), vec![0.0; layout.rows() * N * part]);
        for [column, row] in layout.each_element().filter(|element| is_electric(grid, *element)) {
            let found = within(column, row);
            let at = row * part + column;
            strongest[at] = found.strongest;
            for (q, (share, weight)) in found.points.into_iter().zip(weights).enumerate() {
                values[at] += weight * share;
                points[(row * N + q) * part + column] = share;
            }
        }
        let points = Points {
            values: Both::new(points),
            strongest: Both::new(strongest),
        };
        Self {
            points: Some(Arc::new(points)),
            is_binary: false,
            ..Self::of_values(grid, values)
        }
    }

    fn of_values(grid: &Grid, mut values: Vec<f64>) -> Self {
        let layout = grid.layout();
        let [columns, rows] = grid.elements();
        if grid.parts().is_some() {
            for [column, row] in layout.each_element().filter(|element| !is_electric(grid, *element)) {
                values[row * layout.part() + column] = 0.0;
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
            points: None,
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

    /// The activity of point `q` of the elements of a row, of so many points each.
    #[must_use]
    pub fn at_point(&self, row: usize, q: usize, points: usize) -> &[f64] {
        let part = self.grid.layout().part();
        match &self.points {
            Some(within) => &within.values.double()[(row * points + q) * part..][..part],
            None => &self.values.double()[row * part..][..part],
        }
    }

    /// The activity of the strongest electrode in each element of a row.
    #[must_use]
    pub fn strongest(&self, row: usize) -> &[f64] {
        let part = self.grid.layout().part();
        let all = self.points.as_ref().map_or(&self.values, |within| &within.strongest);
        &all.double()[row * part..][..part]
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
        let part = self.grid.layout().part();
        let (values, strides, strongest) = match &self.points {
            Some(within) => {
                let points = (self.grid.layout().degree() + 1).pow(2);
                (&within.values, [points * part, part], &within.strongest)
            }
            None => (&self.values, [part, 0], &self.values),
        };
        View {
            values: T::of(values),
            strides,
            strongest: T::of(strongest),
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
    /// Of the points of elements.
    pub values: &'a [T],
    /// From a row of elements to the next, and from one of their points to the next.
    pub strides: [usize; 2],
    /// Of the strongest electrode in each element, in rows of [`NodeLayout::part`] numbers.
    pub strongest: &'a [T],
    pub sides: Option<[&'a [T]; 2]>,
    /// Whether all elements have the same sides.
    pub is_uniform: bool,
    /// The coefficients of an energy beside that of the law, and their [`Memory::weight`].
    pub memory: Option<(&'a [T], f64)>,
}

impl<T: Precision> View<'_, T> {
    /// Of point `q` of the elements from `first` on of a row.
    #[inline(always)]
    pub fn at<S: Simd>(&self, simd: S, [first, row]: [usize; 2], q: usize) -> Wide<S, T> {
        let [rows, points] = self.strides;
        Wide::load(simd, &self.values[row * rows + q * points + first..])
    }

    /// The same as it counts for a loss of stability: what is a part of an electrode is lost no sooner than all of it.
    #[inline(always)]
    pub fn within_electrode<S: Simd>(&self, simd: S, part: usize, [first, row]: [usize; 2], q: usize) -> Wide<S, T> {
        let active = self.at(simd, [first, row], q);
        let strongest = Wide::load(simd, &self.strongest[row * part + first..]);
        active.max(active.constant(0.0)).min(strongest)
    }
}

/// Whether there can be a field in an element (column, row): not in frames and bodies.
fn is_electric(grid: &Grid, [column, row]: [usize; 2]) -> bool {
    let [along, across] = grid.per_cell();
    grid.is_membrane(column / along, row / across)
}
