//! Elements that electrodes cover in part, with their laminates.

mod normals;

use std::sync::Arc;

use deaflow_pattern::{Coverage, Part};

use self::normals::Normals;
use super::grid::Grid;
#[cfg(doc)]
use super::layout::NodeLayout;
use super::precision::BothPrecisions;

/// A point that an electrode covers in part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laminate {
    /// The share S that is covered.
    pub share: f64,
    /// Share of the load of the electrode.
    pub load: f64,
    /// Unit normal of the edge, in the coordinates of gradients; its sign does not matter.
    pub normal: [f64; 2],
}

impl Laminate {
    /// Returns whether it has both layers.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.share > 0.0 && self.share < 1.0
    }
}

/// The elements of a pattern that electrodes cover in part.
#[derive(Clone, Debug)]
pub struct Covered {
    coverage: Arc<Coverage>,
    normals: Normals,
    /// Load of each group.
    loads: Vec<f64>,
    /// Cut elements (column, row) in ascending order of row and column.
    elements: Vec<CutElement>,
    /// Activity of each element, in rows of [`NodeLayout::part`] numbers; 0 in those that are cut, whose layers are
    /// looked at separately.
    of_uncut_elements: BothPrecisions,
}

/// An element that is cut by an edge.
#[derive(Clone, Copy, Debug)]
pub struct CutElement {
    /// Column and row.
    pub at: [usize; 2],
    /// The laminate of all its points.
    pub laminate: Laminate,
}

impl Covered {
    /// Finds the cut elements, given the activity of each element in rows of [`NodeLayout::part`] numbers, and the load
    /// of each group.
    pub fn new(grid: &Grid, linear: &[f64], coverage: &Arc<Coverage>, loads: &[f64]) -> Self {
        let part = grid.layout().part();
        let mut covered = Self {
            coverage: Arc::clone(coverage),
            normals: Normals::new(coverage.raster()),
            loads: loads.to_vec(),
            elements: Vec::new(),
            of_uncut_elements: BothPrecisions::new(Vec::new()),
        };
        let mut uncut = linear.to_vec();
        for at in grid
            .each_element()
            .filter(|at| grid.content(*at).part == Part::Membrane)
        {
            if let Some(laminate) = covered.laminate_of_cut_cell(grid, grid.cell_of(at)) {
                uncut[at[1] * part + at[0]] = 0.0;
                covered.elements.push(CutElement { at, laminate });
            }
        }
        covered.of_uncut_elements = BothPrecisions::new(uncut);
        covered
    }

    /// Returns the activity of the elements that are not cut.
    pub fn of_uncut_elements(&self) -> &BothPrecisions {
        &self.of_uncut_elements
    }

    /// Returns the laminate of a cell (column, row), also of a covered or bare one at an edge; `None` far from edges,
    /// and where a cell has no normal, as a lone one. There the energy is linear in the share.
    pub fn laminate_of_cell(&self, grid: &Grid, [x, y]: [usize; 2]) -> Option<Laminate> {
        Some(Laminate {
            share: self.coverage.share(x, y),
            load: self.load_of_cell(x, y),
            normal: self.normals.at(grid, &self.coverage, [x, y])?,
        })
    }

    /// Returns the same of a cell that an electrode covers in part.
    pub fn laminate_of_cut_cell(&self, grid: &Grid, [x, y]: [usize; 2]) -> Option<Laminate> {
        let share = self.coverage.share(x, y);
        (share > 0.0 && share < 1.0)
            .then(|| self.laminate_of_cell(grid, [x, y]))
            .flatten()
    }

    /// Returns the load of the electrode of a cell; the full one for a bare cell.
    pub fn load_of_cell(&self, x: usize, y: usize) -> f64 {
        match usize::from(self.coverage.group(x, y)) {
            0 => 1.0,
            group => self.loads[group - 1],
        }
    }

    /// Returns the cut elements.
    pub fn elements(&self) -> &[CutElement] {
        &self.elements
    }

    /// Returns the derivatives of the angle of the normal of a cell (column, row) with respect to the shares of cells.
    pub fn slopes_of_angle(&self, grid: &Grid, cell: [usize; 2]) -> Vec<([usize; 2], f64)> {
        self.normals.slopes(grid, &self.coverage, cell)
    }

    /// Returns the laminate of a cut element (column, row); `None` for another one.
    pub fn laminate(&self, [column, row]: [usize; 2]) -> Option<&Laminate> {
        let found = self
            .elements
            .binary_search_by_key(&[row, column], |cut| [cut.at[1], cut.at[0]]);
        found.ok().map(|at| &self.elements[at].laminate)
    }
}
