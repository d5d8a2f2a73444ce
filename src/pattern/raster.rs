//! The raster of square cells that a pattern is drawn on.

use std::fmt;

use super::bits::Bits;
use super::symmetry::{Symmetries, Symmetry};
use deaflow_base::OrbitId;

/// Cells along one side of the membrane. The source paper's membrane has 50 × 50.
pub const CELLS: usize = 50;

/// How many cells a membrane has along its sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Raster {
    columns: u16,
    rows: u16,
}

/// An electrode pattern: cells `[y][x]` with the origin at the lower left, each with the number of its group of electrodes, or bare with 0.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pattern {
    raster: Raster,
    cells: Box<[u8]>,
}

/// What patterns of a device are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PatternForm {
    /// Their cells.
    pub raster: Raster,
    /// How many groups of electrodes they may have.
    pub groups: usize,
}

impl PatternForm {
    /// That of the source paper's membrane.
    pub const PAPER: Self = Self::bare_or_electrode(Raster::PAPER);

    /// One group of electrodes.
    #[must_use]
    pub const fn bare_or_electrode(raster: Raster) -> Self {
        Self { raster, groups: 1 }
    }
}

/// What a cell may be where there are so many groups, in words.
#[must_use]
pub fn allowed_cells(groups: usize) -> String {
    match groups {
        1 => "0 (bare) or 1 (electrode)".to_owned(),
        _ => format!("0 (bare) or the number of a group of electrodes, 1 to {groups}"),
    }
}

/// Numbers that are not a pattern.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PatternError {
    /// The wrong number of cells.
    #[error("a pattern has {} cells ({raster}), found {found}", raster.cells())]
    Shape {
        /// The cells that there should be.
        raster: Raster,
        /// How many values there were.
        found: usize,
    },
    /// A value that is neither 0 nor a group.
    #[error("cell [y={y}][x={x}] is {found}; a cell is {}", allowed_cells(*.groups))]
    Value {
        /// Row, from below.
        y: usize,
        /// Column, from the left.
        x: usize,
        /// What stood there.
        found: u8,
        /// How many groups there are.
        groups: usize,
    },
}

impl Raster {
    /// That of the source paper's membrane.
    pub const PAPER: Self = Self {
        columns: CELLS as u16,
        rows: CELLS as u16,
    };

    /// Most cells along a side.
    pub const MOST: usize = 400;

    /// So many columns and rows, 1 to [`Raster::MOST`] of each.
    #[must_use]
    pub fn new(columns: usize, rows: usize) -> Option<Self> {
        let side = |count: usize| (1..=Self::MOST).contains(&count).then_some(count as u16);
        Some(Self {
            columns: side(columns)?,
            rows: side(rows)?,
        })
    }

    /// Cells along x.
    #[must_use]
    pub const fn columns(self) -> usize {
        self.columns as usize
    }

    /// Cells along y.
    #[must_use]
    pub const fn rows(self) -> usize {
        self.rows as usize
    }

    /// Columns and rows.
    #[must_use]
    pub const fn sides(self) -> [usize; 2] {
        [self.columns(), self.rows()]
    }

    /// All cells.
    #[must_use]
    pub const fn cells(self) -> usize {
        self.columns() * self.rows()
    }

    /// Columns and rows of the corners of cells, one more than of cells.
    #[must_use]
    pub const fn corner_sides(self) -> [usize; 2] {
        [self.columns() + 1, self.rows() + 1]
    }

    /// All corners of cells.
    #[must_use]
    pub const fn corners(self) -> usize {
        let [columns, rows] = self.corner_sides();
        columns * rows
    }

    /// Whether there are as many columns as rows.
    #[must_use]
    pub const fn is_square(self) -> bool {
        self.columns == self.rows
    }

    /// The raster of what a symmetry makes of a pattern: quarter turns exchange columns and rows.
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
    /// Most groups of electrodes.
    pub const MOST_GROUPS: usize = 16;

    /// A pattern of one group from its cells, row by row from below.
    ///
    /// # Errors
    /// When there are not as many values as cells, or one is neither 0 nor 1.
    pub fn from_cells(raster: Raster, cells: &[u8]) -> Result<Self, PatternError> {
        Self::of_form(PatternForm::bare_or_electrode(raster), cells)
    }

    /// A pattern from its cells, row by row from below.
    ///
    /// # Errors
    /// When there are not as many values as cells, or one is neither 0 nor a group's number.
    pub fn of_form(form: PatternForm, cells: &[u8]) -> Result<Self, PatternError> {
        let PatternForm { raster, groups } = form;
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
            }),
        }
    }

    /// The pattern whose cell (x, y) is active where `active(x, y)`.
    #[must_use]
    pub fn from_fn(raster: Raster, active: impl Fn(usize, usize) -> bool) -> Self {
        Self::from_groups(raster, |x, y| u8::from(active(x, y)))
    }

    /// The pattern whose cell (x, y) belongs to the group `group(x, y)`, or is bare where that is 0.
    #[must_use]
    pub fn from_groups(raster: Raster, group: impl Fn(usize, usize) -> u8) -> Self {
        let columns = raster.columns();
        Self {
            raster,
            cells: (0..raster.cells()).map(|i| group(i % columns, i / columns)).collect(),
        }
    }

    /// Its columns and rows.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// All cells, row by row from below.
    #[must_use]
    pub fn cells(&self) -> &[u8] {
        &self.cells
    }

    /// Whether the cell at column `x`, row `y` carries an electrode.
    ///
    /// # Panics
    /// When the cell is outside the raster.
    #[must_use]
    pub fn is_active(&self, x: usize, y: usize) -> bool {
        self.group(x, y) != 0
    }

    /// The group of electrodes of the cell at column `x`, row `y`, from 1; 0 where it is bare.
    ///
    /// # Panics
    /// When the cell is outside the raster.
    #[must_use]
    pub fn group(&self, x: usize, y: usize) -> u8 {
        let [columns, rows] = self.raster.sides();
        assert!(x < columns && y < rows, "cell ({x}, {y}) is outside the membrane");
        self.cells[y * columns + x]
    }

    /// The highest number of a group that a cell has; 0 where all are bare.
    #[must_use]
    pub fn groups(&self) -> usize {
        self.cells.iter().max().map_or(0, |&group| usize::from(group))
    }

    /// The cells of one group.
    #[must_use]
    pub fn of_group(&self, group: u8) -> Self {
        Self {
            raster: self.raster,
            cells: self.cells.iter().map(|&cell| u8::from(cell == group)).collect(),
        }
    }

    /// The pattern without what lies outside of some cells of its raster.
    #[must_use]
    pub fn within(&self, room: &Bits) -> Self {
        Self::from_groups(self.raster, |x, y| match room.has(x, y) {
            true => self.group(x, y),
            false => 0,
        })
    }

    /// The pattern with the cells of two groups exchanged.
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
        }
    }

    /// How many cells are active.
    #[must_use]
    pub fn active_cells(&self) -> usize {
        // Counted in bytes, which are added 64 at a time.
        let count = |cells: &[u8]| cells.iter().map(|&cell| u8::from(cell != 0)).sum::<u8>();
        self.cells
            .chunks(usize::from(u8::MAX))
            .map(|cells| usize::from(count(cells)))
            .sum()
    }

    /// The share of active cells, 0 to 1.
    #[must_use]
    pub fn area_fraction(&self) -> f64 {
        self.active_cells() as f64 / self.raster.cells() as f64
    }

    /// The image under a symmetry: `(gS)(gX) = S(X)`.
    #[must_use]
    pub fn transformed(&self, g: Symmetry) -> Self {
        let mut cells = vec![0; self.raster.cells()].into_boxed_slice();
        for (&cell, to) in self.cells.iter().zip(g.permutation(self.raster.sides())) {
            cells[to] = cell;
        }
        let raster = self.raster.transformed(g);
        Self { raster, cells }
    }

    /// The identity shared by a pattern and its images under a group that maps its raster to itself: the digest of the smallest.
    #[must_use]
    pub fn orbit(&self, group: Symmetries) -> OrbitId {
        let smallest = group.iter().map(|g| self.transformed(g)).min();
        let cells = &smallest.as_ref().unwrap_or(self).cells;
        match self.raster == Raster::PAPER {
            true => OrbitId::of(cells),
            // The same numbers may be cells of several rasters.
            false => {
                let sides = [self.raster.columns, self.raster.rows].map(u16::to_le_bytes);
                OrbitId::of(&[sides.as_flattened(), cells].concat())
            }
        }
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
    fn refuses_what_is_not_a_pattern() {
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
