//! The activity of a pattern on each element.
//!
//! Electrode edges within elements, as with a fringe field, have an activity for each point: the integral over the
//! element of activity times any function of the degree of its gradients is exact, and so are the forces of the voltage
//! at rest. Near an edge, activities may be slightly below 0 or above that of the strongest electrode.

use std::sync::Arc;

use pulp::Simd;

use deaflow_pattern::{Coverage, Part, Pattern};

use super::coverage::Covered;
use super::fitted::MappedView;
use super::grid::Grid;
use super::lanes::{Value, Wide};
#[cfg(doc)]
use super::layout::NodeLayout;
use super::memory::Memory;
use super::precision::{BothPrecisions, Precision};

/// The activity of a pattern on a grid.
#[derive(Clone, Debug)]
pub struct Activity {
    grid: Grid,
    /// Activity of each element, in rows of [`NodeLayout::part`] numbers.
    values: BothPrecisions,
    /// Sides of each column and each row of elements, if not all 1.
    sides: Option<[BothPrecisions; 2]>,
    /// Activity of each point, if the points of an element differ.
    points: Option<Arc<Points>>,
    /// Whether each element is either active or bare.
    is_binary: bool,
    /// Elements that electrodes cover in part, if any.
    covered: Option<Arc<Covered>>,
    /// An additional energy.
    memory: Option<Arc<Memory>>,
}

/// Activities at points.
#[derive(Debug)]
struct Points {
    /// Activity of each point, in lines of [`NodeLayout::part`] numbers for the points of each row of elements.
    values: BothPrecisions,
    /// Activity of the strongest electrode in each element.
    strongest: BothPrecisions,
}

/// Activities of the points of an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Within<const N: usize> {
    /// Activity of each point.
    pub points: [f64; N],
    /// Activity of the strongest electrode.
    pub strongest: f64,
}

impl Activity {
    /// Creates the activity of a pattern whose electrodes all have the full load.
    #[must_use]
    pub fn new(grid: &Grid, pattern: &Pattern) -> Self {
        Self::from_shares(grid, |x, y| f64::from(u8::from(pattern.is_active(x, y))))
    }

    /// Creates the activity of a pattern with a share of the load for each electrode group.
    ///
    /// # Panics
    /// If a cell belongs to a group without share.
    #[must_use]
    pub fn of_groups(grid: &Grid, pattern: &Pattern, loads: &[f64]) -> Self {
        if grid.follows_borders().is_none() {
            return Self::from_shares(grid, |x, y| load_of(pattern.group(x, y), loads));
        }
        Self::from_elements(grid, |element| {
            let of_pattern = || {
                let [x, y] = grid.cell_of(element);
                pattern.group(x, y)
            };
            load_of(grid.content(element).group.unwrap_or_else(of_pattern), loads)
        })
    }

    /// Creates the activity of electrodes that cover parts of cells, with a share of the load for each electrode group.
    /// Elements of cells that are cut by an edge are laminates; kernels see them as linear in the share.
    ///
    /// # Panics
    /// If a cell belongs to a group without share.
    #[must_use]
    pub fn of_coverage(grid: &Grid, coverage: &Arc<Coverage>, loads: &[f64]) -> Self {
        let linear = Self::from_elements(grid, |element| {
            let [x, y] = grid.cell_of(element);
            coverage.share(x, y) * load_of(coverage.group(x, y), loads)
        });
        let covered = Covered::new(grid, linear.elements(), coverage, loads);
        Self {
            covered: Some(Arc::new(covered)),
            ..linear
        }
    }

    /// Creates an activity from a share for each cell (column, row), with respect to which patterns are differentiated.
    #[must_use]
    pub fn from_shares(grid: &Grid, share: impl Fn(usize, usize) -> f64) -> Self {
        let layout = grid.layout();
        let mut values = vec![0.0; layout.element_rows() * layout.part()];
        grid.write_activity(&share, &mut values);
        Self::of_values(grid, values)
    }

    /// Creates an activity from a share for each element (column, row).
    #[must_use]
    pub fn from_elements(grid: &Grid, share: impl Fn([usize; 2]) -> f64) -> Self {
        let layout = grid.layout();
        let mut values = vec![0.0; layout.element_rows() * layout.part()];
        for [column, row] in grid.each_element() {
            values[row * layout.part() + column] = share([column, row]);
        }
        Self::of_values(grid, values)
    }

    /// Creates an activity whose points, of these weights, differ in each element (column, row).
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
            values: BothPrecisions::new(points),
            strongest: BothPrecisions::new(strongest),
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
            for [column, row] in grid.each_element().filter(|element| !is_electric(grid, *element)) {
                values[row * layout.part() + column] = 0.0;
            }
        }
        // Past the last element it is 1, because kernels divide by it.
        let width = |at: usize| if at < columns { grid.sides([at, 0])[0] } else { 1.0 };
        let widths = || BothPrecisions::new((0..layout.part()).map(width).collect());
        let heights = || BothPrecisions::new((0..rows).map(|at| grid.sides([0, at])[1]).collect());
        Self {
            grid: grid.clone(),
            is_binary: values.iter().all(|value| *value == 0.0 || *value == 1.0),
            values: BothPrecisions::new(values),
            points: None,
            sides: (!grid.is_plain()).then(|| [widths(), heights()]),
            covered: None,
            memory: None,
        }
    }

    /// Adds an energy.
    #[must_use]
    pub fn with_memory(&self, memory: Memory) -> Self {
        Self {
            memory: Some(Arc::new(memory)),
            ..self.clone()
        }
    }

    /// Returns the additional energy for reuse, unless it is shared.
    #[must_use]
    pub fn into_memory(self) -> Option<Memory> {
        Arc::into_inner(self.memory?)
    }

    /// Returns the additional energy.
    #[must_use]
    pub fn memory(&self) -> Option<&Memory> {
        self.memory.as_deref()
    }

    /// Returns the elements that electrodes cover in part; `None` if electrodes cover whole cells.
    #[must_use]
    pub fn covered(&self) -> Option<&Covered> {
        self.covered.as_deref()
    }

    /// Returns whether each element is either active or bare.
    #[must_use]
    pub fn is_binary(&self) -> bool {
        self.is_binary
    }

    /// Returns the grid.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the activity of each element, in rows of [`NodeLayout::part`] numbers.
    #[must_use]
    pub fn elements(&self) -> &[f64] {
        self.values.double()
    }

    /// Returns the activity of point `q` of the elements of a row; `points` is the number of points of an element.
    #[must_use]
    pub fn at_point(&self, row: usize, q: usize, points: usize) -> &[f64] {
        let part = self.grid.layout().part();
        match &self.points {
            Some(within) => &within.values.double()[(row * points + q) * part..][..part],
            None => &self.values.double()[row * part..][..part],
        }
    }

    /// Returns the activity of the strongest electrode in each element of a row.
    #[must_use]
    pub fn strongest(&self, row: usize) -> &[f64] {
        let part = self.grid.layout().part();
        let all = self.points.as_ref().map_or(&self.values, |within| &within.strongest);
        &all.double()[row * part..][..part]
    }

    /// Returns the active area of an element (column, row), in units of the mean area of elements.
    #[must_use]
    pub fn area(&self, [column, row]: [usize; 2]) -> f64 {
        let share = self.values.double()[row * self.grid.layout().part() + column];
        share * self.grid.area_of([column, row])
    }

    /// Returns the data for kernels.
    #[must_use]
    pub(super) fn view<T: Precision>(&self) -> View<'_, T> {
        let part = self.grid.layout().part();
        let (values, strides, strongest) = match &self.points {
            Some(within) => {
                let points = (self.grid.layout().degree() + 1).pow(2);
                (&within.values, [points * part, part], &within.strongest)
            }
            None => {
                let covered = self.covered.as_ref();
                let strongest = covered.map_or(&self.values, |covered| covered.of_uncut_elements());
                (&self.values, [part, 0], strongest)
            }
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
            mapped: self.grid.follows_borders().map(|fitted| fitted.mapped().view()),
            memory: self.memory().map(|memory| (memory.view(), memory.weight)),
        }
    }
}

/// Returns the share of the load of an electrode group; 0 for bare cells.
///
/// # Panics
/// If the group has none.
#[must_use]
pub fn load_of(group: u8, loads: &[f64]) -> f64 {
    match group {
        0 => 0.0,
        _ => loads[usize::from(group) - 1],
    }
}

/// An activity in one precision, for kernels.
#[derive(Clone, Copy)]
pub(super) struct View<'a, T> {
    /// Activity of the points of elements.
    pub values: &'a [T],
    /// Distance from a row of elements to the next, and from one point to the next.
    pub strides: [usize; 2],
    /// Activity of the strongest electrode in each element, in rows of [`NodeLayout::part`] numbers.
    pub strongest: &'a [T],
    pub sides: Option<[&'a [T]; 2]>,
    /// Whether all elements have equal sides.
    pub is_uniform: bool,
    /// Mapped elements, if any.
    pub mapped: Option<MappedView<'a, T>>,
    /// Coefficients of the additional energy, and their [`Memory::weight`].
    pub memory: Option<(&'a [T], f64)>,
}

impl<T: Precision> View<'_, T> {
    /// Returns the activity of point `q` of the elements of a row, from `first` on.
    #[inline(always)]
    pub fn at<S: Simd>(&self, simd: S, [first, row]: [usize; 2], q: usize) -> Wide<S, T> {
        let [rows, points] = self.strides;
        Wide::load(simd, &self.values[row * rows + q * points + first..])
    }

    /// Returns the activity for checks of stability, where part of an electrode counts as the whole.
    #[inline(always)]
    pub fn within_electrode<S: Simd>(&self, simd: S, part: usize, [first, row]: [usize; 2], q: usize) -> Wide<S, T> {
        let active = self.at(simd, [first, row], q);
        let strongest = Wide::load(simd, &self.strongest[row * part + first..]);
        active.max(active.constant(0.0)).min(strongest)
    }
}

/// Returns whether an element (column, row) can have an electric field: not in frames and bodies.
fn is_electric(grid: &Grid, element: [usize; 2]) -> bool {
    grid.content(element).part == Part::Membrane
}
