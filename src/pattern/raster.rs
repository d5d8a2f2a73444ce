//! The raster of cells that carries a pattern.

use std::fmt;
use std::sync::Arc;

use super::coverage::Coverage;
use super::electrodes::Electrodes;
use super::membrane::Membrane;
use super::symmetry::{Symmetries, Symmetry};
use deaflow_base::OrbitId;

/// Cells along one side of the membrane of the source paper.
pub const CELLS: usize = 50;

/// The numbers of cells along the sides of a membrane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Raster {
    columns: u16,
    rows: u16,
}

/// An electrode pattern: the electrode group of each cell, `[y][x]` with the origin at the lower left; 0 for a bare
/// cell.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pattern {
    raster: Raster,
    cells: Box<[u8]>,
    /// The shapes of the electrodes, if elements follow them. The cells are then those with their centre in a shape.
    electrodes: Option<Arc<Electrodes>>,
    /// The share of each cell that is covered, if electrodes cover parts of cells. The cells are then those that are
    /// covered by half or more.
    coverage: Option<Arc<Coverage>>,
}

/// The raster, the number of electrode groups and the size of the patterns of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatternForm {
    /// The raster.
    pub raster: Raster,
    /// The number of electrode groups.
    pub groups: usize,
    /// The sides of the membrane along x and y in mm, where they are known.
    pub size_mm: Option<[f64; 2]>,
}

impl PatternForm {
    /// The form for the membrane of the source paper.
    pub const PAPER: Self = Self::bare_or_electrode(Raster::PAPER);

    /// Returns the form with one electrode group and square cells.
    #[must_use]
    pub const fn bare_or_electrode(raster: Raster) -> Self {
        Self::of_square_cells(raster, 1)
    }

    /// Returns the form with square cells.
    #[must_use]
    pub const fn of_square_cells(raster: Raster, groups: usize) -> Self {
        Self {
            raster,
            groups,
            size_mm: None,
        }
    }

    /// Returns the form of patterns on a membrane.
    #[must_use]
    pub fn on(membrane: &Membrane, groups: usize) -> Self {
        Self {
            raster: membrane.raster,
            groups,
            size_mm: Some(membrane.size_mm),
        }
    }

    /// Returns the membrane, where its size is known.
    #[must_use]
    pub fn membrane(&self) -> Option<Membrane> {
        let raster = self.raster;
        self.size_mm.map(|size_mm| Membrane { raster, size_mm })
    }

    /// Returns the height of a cell over its width; 1 if it is not known.
    #[must_use]
    pub fn cell_ratio(&self) -> f64 {
        self.membrane().map_or(1.0, |membrane| {
            let [width, height] = membrane.cell_mm();
            height / width
        })
    }
}

/// Describes the allowed values of a cell.
#[must_use]
pub fn allowed_cells(groups: usize) -> String {
    match groups {
        1 => "0 (bare) or 1 (electrode)".to_owned(),
        _ => format!("0 (bare) or the number of an electrode group, 1 to {groups}"),
    }
}

/// Why values are not a pattern.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PatternError {
    /// The wrong number of cells.
    #[error("a pattern has {} cells ({raster}), found {found}", raster.cells())]
    Shape {
        /// The expected raster.
        raster: Raster,
        /// The number of values found.
        found: usize,
    },
    /// A value that is neither 0 nor an electrode group.
    #[error("cell [y={y}][x={x}] is {found}; a cell is {}", allowed_cells(*.groups))]
    Value {
        /// Row, from below.
        y: usize,
        /// Column, from the left.
        x: usize,
        /// The value found.
        found: u8,
        /// The number of electrode groups.
        groups: usize,
    },
}

impl Raster {
    /// The raster of the source paper.
    pub const PAPER: Self = Self {
        columns: CELLS as u16,
        rows: CELLS as u16,
    };

    /// Largest number of cells along a side.
    pub const MOST: usize = 400;

    /// Returns the raster with these columns and rows, 1 to [`Raster::MOST`] of each.
    #[must_use]
    pub fn new(columns: usize, rows: usize) -> Option<Self> {
        let side = |count: usize| (1..=Self::MOST).contains(&count).then_some(count as u16);
        Some(Self {
            columns: side(columns)?,
            rows: side(rows)?,
        })
    }

    /// Returns the number of cells along x.
    #[must_use]
    pub const fn columns(self) -> usize {
        self.columns as usize
    }

    /// Returns the number of cells along y.
    #[must_use]
    pub const fn rows(self) -> usize {
        self.rows as usize
    }

    /// Returns the numbers of columns and rows.
    #[must_use]
    pub const fn sides(self) -> [usize; 2] {
        [self.columns(), self.rows()]
    }

    /// Returns the columns and rows that a search of designs on so many units along a side switches: those of units, or
    /// of cells where these are fewer. [`CELLS`] units are single cells.
    #[must_use]
    pub fn unit_sides(self, units: u64) -> [usize; 2] {
        match usize::try_from(units) {
            Ok(units) if units != CELLS => self.sides().map(|cells| cells.min(units)),
            _ => self.sides(),
        }
    }

    /// Returns the number of cells.
    #[must_use]
    pub const fn cells(self) -> usize {
        self.columns() * self.rows()
    }

    /// Returns the numbers of columns and rows of cell corners, one more than of cells.
    #[must_use]
    pub const fn corner_sides(self) -> [usize; 2] {
        [self.columns() + 1, self.rows() + 1]
    }

    /// Returns the number of cell corners.
    #[must_use]
    pub const fn corners(self) -> usize {
        let [columns, rows] = self.corner_sides();
        columns * rows
    }

    /// Returns whether there are as many columns as rows.
    #[must_use]
    pub const fn is_square(self) -> bool {
        self.columns == self.rows
    }

    /// Returns the raster of patterns after a symmetry: quarter turns exchange columns and rows.
    #[must_use]
    pub fn transformed(self, g: Symmetry) -> Self {
        match g.exchanges_axes() {
            true => Self {
                columns: self.rows,
                rows: self.columns,
            },
            false => self,
        }
    }
}

impl fmt::Display for Raster {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} × {}", self.columns, self.rows)
    }
}

impl Pattern {
    /// Largest number of electrode groups.
    pub const MOST_GROUPS: usize = 16;

    /// Builds a pattern of one group from its cells, row by row from below.
    ///
    /// # Errors
    /// When the number of values is not the number of cells, or a value is neither 0 nor 1.
    pub fn from_cells(raster: Raster, cells: &[u8]) -> Result<Self, PatternError> {
        Self::of_form(PatternForm::bare_or_electrode(raster), cells)
    }

    /// Builds a pattern from its cells, row by row from below.
    ///
    /// # Errors
    /// When the number of values is not the number of cells, or a value is neither 0 nor an electrode group.
    pub fn of_form(form: PatternForm, cells: &[u8]) -> Result<Self, PatternError> {
        let PatternForm { raster, groups, .. } = form;
        let found = cells.len();
        if found != raster.cells() {
            return Err(PatternError::Shape { raster, found });
        }
        match cells.iter().position(|&c| usize::from(c) > groups) {
            Some(at) => Err(PatternError::Value {
                y: at / raster.columns(),
                x: at % raster.columns(),
                found: cells[at],
                groups,
            }),
            None => Ok(Self {
                raster,
                cells: cells.into(),
                electrodes: None,
                coverage: None,
            }),
        }
    }

    /// Builds the pattern whose cell (x, y) is active if `active(x, y)`.
    #[must_use]
    pub fn from_fn(raster: Raster, active: impl Fn(usize, usize) -> bool) -> Self {
        Self::from_groups(raster, |x, y| u8::from(active(x, y)))
    }

    /// Builds the pattern whose cell (x, y) belongs to the electrode group `group(x, y)`; 0 is bare.
    #[must_use]
    pub fn from_groups(raster: Raster, group: impl Fn(usize, usize) -> u8) -> Self {
        let columns = raster.columns();
        Self {
            raster,
            cells: (0..raster.cells()).map(|i| group(i % columns, i / columns)).collect(),
            electrodes: None,
            coverage: None,
        }
    }

    /// Returns the pattern with electrodes whose edges elements follow, and whose cells are those of the pattern.
    #[must_use]
    pub fn with_electrodes(self, electrodes: Option<Arc<Electrodes>>) -> Self {
        Self { electrodes, ..self }
    }

    /// Returns the shapes of the electrodes, if elements follow them; `None` if electrodes are those of the cells.
    #[must_use]
    pub fn electrodes(&self) -> Option<&Arc<Electrodes>> {
        self.electrodes.as_ref()
    }

    /// Builds the pattern of electrodes that cover parts of cells. Its cells are those that are covered by half or
    /// more; if no cell is covered in part, it is the pattern of these cells.
    #[must_use]
    pub fn of_coverage(coverage: Coverage) -> Self {
        Self {
            raster: coverage.raster(),
            cells: coverage.cells().into(),
            electrodes: None,
            coverage: coverage.has_cut_cells().then(|| Arc::new(coverage)),
        }
    }

    /// Like [`Pattern::of_coverage`], but keeps the shares if no cell is covered in part, so that a gradient is that
    /// with respect to them.
    #[must_use]
    pub fn of_shares(coverage: Coverage) -> Self {
        let coverage = Arc::new(coverage);
        Self {
            coverage: Some(Arc::clone(&coverage)),
            ..Self::of_coverage(Arc::unwrap_or_clone(coverage))
        }
    }

    /// Returns the share of each cell that is covered, if electrodes cover parts of cells.
    #[must_use]
    pub fn coverage(&self) -> Option<&Arc<Coverage>> {
        self.coverage.as_ref()
    }

    /// Returns the raster.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// Returns all cells, row by row from below.
    #[must_use]
    pub fn cells(&self) -> &[u8] {
        &self.cells
    }

    /// Returns whether the cell at column `x`, row `y` has an electrode.
    ///
    /// # Panics
    /// When the cell is outside the raster.
    #[must_use]
    pub fn is_active(&self, x: usize, y: usize) -> bool {
        self.group(x, y) != 0
    }

    /// Returns the electrode group of the cell at column `x`, row `y`, from 1; 0 for a bare cell.
    ///
    /// # Panics
    /// When the cell is outside the raster.
    #[must_use]
    pub fn group(&self, x: usize, y: usize) -> u8 {
        let [columns, rows] = self.raster.sides();
        assert!(x < columns && y < rows, "cell ({x}, {y}) is outside the membrane");
        self.cells[y * columns + x]
    }

    /// Returns the highest electrode group of a cell, a part of one or a shape; 0 without electrodes.
    #[must_use]
    pub fn groups(&self) -> usize {
        let drawn = self.electrodes.iter().flat_map(|electrodes| electrodes.groups());
        let covered = self.coverage.iter().flat_map(|coverage| coverage.groups());
        let all = self.cells.iter().chain(drawn.map(|(group, _)| group)).chain(covered);
        all.max().map_or(0, |&group| usize::from(group))
    }

    /// Returns the cells of one group as a pattern of one group.
    #[must_use]
    pub fn of_group(&self, group: u8) -> Self {
        Self {
            raster: self.raster,
            cells: self.cells.iter().map(|&cell| u8::from(cell == group)).collect(),
            electrodes: None,
            coverage: None,
        }
    }

    /// Returns the pattern with the cells of two groups exchanged.
    #[must_use]
    pub fn with_groups_exchanged(&self, [a, b]: [u8; 2]) -> Self {
        let exchanged = |&cell: &u8| match cell {
            cell if cell == a => b,
            cell if cell == b => a,
            cell => cell,
        };
        Self {
            raster: self.raster,
            cells: self.cells.iter().map(exchanged).collect(),
            electrodes: None,
            coverage: None,
        }
    }

    /// Returns the number of active cells.
    #[must_use]
    pub fn active_cells(&self) -> usize {
        // Counting in bytes lets the compiler add 64 of them at a time.
        let count = |cells: &[u8]| cells.iter().map(|&cell| u8::from(cell != 0)).sum::<u8>();
        self.cells
            .chunks(usize::from(u8::MAX))
            .map(|cells| usize::from(count(cells)))
            .sum()
    }

    /// Returns the image under a symmetry: `(gS)(gX) = S(X)`.
    #[must_use]
    pub fn transformed(&self, g: Symmetry) -> Self {
        let mut cells = vec![0; self.raster.cells()].into_boxed_slice();
        for (&cell, to) in self.cells.iter().zip(g.permutation(self.raster.sides())) {
            cells[to] = cell;
        }
        let image = |electrodes: &Arc<Electrodes>| Arc::new(electrodes.transformed(g));
        Self {
            raster: self.raster.transformed(g),
            cells,
            electrodes: self.electrodes.as_ref().map(image),
            coverage: self.coverage.as_ref().map(|coverage| Arc::new(coverage.transformed(g))),
        }
    }

    /// Returns the id shared by a pattern and its images under a group that keeps the raster: the digest of the
    /// smallest image.
    #[must_use]
    pub fn orbit(&self, group: Symmetries) -> OrbitId {
        let smallest = group.iter().map(|g| self.transformed(g)).min();
        let smallest = smallest.as_ref().unwrap_or(self);
        let cells = &smallest.cells;
        // Different rasters may have the same cell values, and different shapes and shares the same cells.
        let sides = [self.raster.columns, self.raster.rows].map(u16::to_le_bytes);
        let shapes = match (&smallest.electrodes, &smallest.coverage) {
            (None, None) if self.raster == Raster::PAPER => return OrbitId::of(cells),
            (None, None) => Vec::new(),
            (Some(electrodes), _) => electrodes.bytes(),
            (None, Some(coverage)) => coverage.bytes(),
        };
        OrbitId::of(&[sides.as_flattened(), cells, &shapes].concat())
    }
}

impl fmt::Debug for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Pattern({} of {} cells active)", self.active_cells(), self.raster)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_patterns_are_rejected() {
        assert_eq!(
            Pattern::from_cells(Raster::PAPER, &[0; 10]).unwrap_err(),
            PatternError::Shape {
                raster: Raster::PAPER,
                found: 10
            }
        );
        let mut cells = vec![0; 2500];
        cells[103] = 2;
        assert_eq!(
            Pattern::from_cells(Raster::PAPER, &cells).unwrap_err(),
            PatternError::Value {
                y: 2,
                x: 3,
                found: 2,
                groups: 1
            }
        );
        assert!(Raster::new(0, 3).is_none() && Raster::new(3, 401).is_none());
        assert_eq!(Raster::new(400, 1).unwrap().to_string(), "400 × 1");
    }

    /// Some rasters, and a pattern without symmetry on each.
    fn odd() -> impl Iterator<Item = Pattern> {
        let rasters = [(50, 50), (7, 3), (3, 80), (1, 9), (120, 60)];
        rasters
            .map(|(columns, rows)| Raster::new(columns, rows).unwrap())
            .into_iter()
            .map(|raster| Pattern::from_fn(raster, |x, y| (3 * x + y * y) % 7 < 3 && 2 * x > y / 2))
    }

    #[test]
    fn a_rotation_carries_the_lower_left_corner_to_the_lower_right() {
        let raster = Raster::new(7, 4).unwrap();
        let corner = Pattern::from_fn(raster, |x, y| x == 0 && y == 0);
        let turned = corner.transformed(Symmetry::ALL[1]);
        assert_eq!(turned.raster().sides(), [4, 7]);
        assert!(turned.is_active(3, 0));
    }

    #[test]
    fn all_images_share_one_orbit() {
        for pattern in odd() {
            let group = match pattern.raster().is_square() {
                true => Symmetries::SQUARE,
                false => Symmetries::RECTANGLE,
            };
            for g in Symmetry::ALL {
                let image = pattern.transformed(g);
                if group.contains(g) {
                    assert_eq!(image.orbit(group), pattern.orbit(group));
                }
                assert_eq!(image.transformed(g.inverse()), pattern);
                assert_eq!(image.active_cells(), pattern.active_cells());
            }
            let mut other = pattern.cells().to_vec();
            other[8] ^= 1;
            let other = Pattern::from_cells(pattern.raster(), &other).unwrap();
            assert_ne!(other.orbit(group), pattern.orbit(group));
        }
    }
}
